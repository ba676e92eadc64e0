"""The photographs of a scene, however many: read when they are looked at, and little of each is kept."""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.observations.photograph import Photograph, read_photograph
from fit_material.fitter.result.schema import InputFile
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.rays.picture import LARGEST_SIDE
from fit_material.renderer.scene.scene_file import PhotographSpec

KEPT = 256 << 20  # bytes of photographs that are kept to be looked at again; beyond them a file is read anew
FULL_SIZE = 32  # thumbnails of LARGEST_SIDE; more of them are smaller, so that together they take no more memory


@dataclass(frozen=True)
class Thumbnail:
    """What stays of a photograph: every `step`-th pixel in both directions, and remarks on it.

    Attributes:
        name, camera, exposure, clipped, nonfinite, inputs: the photograph's.
        radiance: [h, w, 3].
        mask: [h, w].
        step: distance between the pixels.
    """

    name: str
    camera: Camera
    exposure: float | None
    clipped: int
    nonfinite: int
    inputs: tuple[InputFile, ...]
    radiance: Float[Tensor, "h w 3"]
    mask: Bool[Tensor, "h w"]
    step: int

    @staticmethod
    def of(photograph: Photograph, side: int) -> Thumbnail:
        """The photograph with at most `side` pixels along either side."""
        step = -(-max(photograph.mask.shape) // side)
        return Thumbnail(
            photograph.name,
            photograph.camera,
            photograph.exposure,
            photograph.clipped,
            photograph.nonfinite,
            photograph.inputs,
            photograph.radiance[::step, ::step].clone(),  # a view would hold the whole photograph
            photograph.mask[::step, ::step].clone(),
            step,
        )


class Album(Sequence[Photograph]):
    """Photographs that are read on demand, one at a time.

    Of those that were read, the first are kept as they are, `KEPT` bytes of them, and of every one a thumbnail. Memory
    so does not grow with their number beyond that, but by some hundred bytes for each.

    Attributes:
        seconds: spent in reading so far.

    Raises:
        InputError: where a photograph that is used is missing or wrong; see `read_photograph`.
    """

    def __init__(self, readers: Iterable[Callable[[], Photograph]]) -> None:
        self.seconds = 0.0
        self._readers = tuple(readers)
        self._kept: dict[int, Photograph] = {}
        self._thumbnails: dict[int, Thumbnail] = {}

    @staticmethod
    def of_scene(photographs: Sequence[PhotographSpec], scene_file: Path) -> Album:
        """The photographs of a scene file's tables."""
        return Album(partial(read_photograph, spec, scene_file, i) for i, spec in enumerate(photographs))

    @staticmethod
    def of(photographs: Iterable[Photograph]) -> Album:
        """Photographs that somebody else keeps."""
        return Album(partial(_itself, photograph) for photograph in photographs)

    def taken_by(self, cameras: Sequence[Camera]) -> Album:
        """The same photographs with other cameras."""
        return Album(partial(_taken_by, self, index, camera) for index, camera in enumerate(cameras))

    def __len__(self) -> int:
        return len(self._readers)

    def __getitem__(self, index: int) -> Photograph:  # type: ignore[override] — a slice would hold many at once
        return self._kept[index] if index in self._kept else self._read(index)

    @property
    def thumbnails(self) -> list[Thumbnail]:
        """Of all photographs; those not read so far are read."""
        for index in range(len(self)):
            if index not in self._thumbnails:
                self._read(index)
        return [self._thumbnails[index] for index in range(len(self))]

    def _read(self, index: int) -> Photograph:
        begun = time.perf_counter()
        _return_freed_memory()
        photograph = self._readers[index]()
        self._thumbnails[index] = Thumbnail.of(photograph, thumbnail_side(len(self)))
        if _bytes([*self._kept.values(), photograph]) <= KEPT:
            self._kept[index] = photograph
        self.seconds += time.perf_counter() - begun
        return photograph


def thumbnail_side(count: int) -> int:
    """The longest side of each of so many thumbnails, in pixels."""
    return max(1, int(LARGEST_SIDE * min(1.0, math.sqrt(FULL_SIZE / count))))


def _return_freed_memory() -> None:
    """Let the system have what earlier photographs took, where the C library is glibc.

    It keeps freed blocks of up to 32 MB, and what stays of each photograph lies between them: of 100 photographs of 12
    megapixels they would add up to 2 GB.
    """
    with suppress(AttributeError, OSError, TypeError):  # another C library, or none that is found so
        ctypes.CDLL(None).malloc_trim(0)


def _bytes(photographs: Iterable[Photograph]) -> int:
    return sum(each.radiance.nbytes + each.mask.nbytes for each in photographs)


def _taken_by(album: Album, index: int, camera: Camera) -> Photograph:
    return replace(album[index], camera=camera)


def _itself(photograph: Photograph) -> Photograph:
    return photograph
