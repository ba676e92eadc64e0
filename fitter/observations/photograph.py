"""Photographs: image, mask, camera of one `[[photographs]]` table, as radiance with the pixels to trust."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.result.schema import InputFile
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.digests import sha256_of
from fit_material.renderer.images.image_file import LOSSY, read_image
from fit_material.renderer.photographs.clipping import dilated
from fit_material.renderer.photographs.exposure import expose
from fit_material.renderer.scene.lens_spec import LensSpec
from fit_material.renderer.scene.scene_file import PhotographSpec, camera_of

FAINTEST, BRIGHTEST = 1e-20, 1e20  # beyond these, squares leave float32
PROPORTIONS = 0.02  # by which a lens's picture may differ in width over height, as small ones are rounded
COVERED = 1 - 1e-3  # alpha of a fully covered pixel, less the rounding of half floats and of many samples' mean


@dataclass(frozen=True)
class Photograph:
    """A photograph ready to be fitted.

    Attributes:
        name: the image file's name without its ending.
        radiance: linear Rec. 709, float32 [h, w, 3], divided by the exposure where that is a number; 0 where
            the file's value is not finite.
        mask: pixels to use, [h, w]: masked in, fully covered, finite and not clipped.
        camera: where it was taken from.
        exposure: pixel = exposure · radiance; None where it is fitted, and `radiance` holds the pixels. 1 where
            several exposures were merged.
        clipped: pixels left out because a channel of them or of a neighbour is near the largest code of an integer
            file, or its sensor was full, in every exposure.
        nonfinite: pixels left out only because a channel is NaN or infinite.
        inputs: the files that it was read from.
        lossy: whether a file is compressed by blocks, within which errors go together.
        outline: pixels that are mostly the object's, by alpha channel and mask as they are, [h, w]; None without
            either.
        full: pixels left out of which a channel is known to be clipped itself, [h, w]; None where none is.
        white: radiance from which on each channel is, [3]; None with `full`.
    """

    name: str
    radiance: Float[Tensor, "h w 3"]
    mask: Bool[Tensor, "h w"]
    camera: Camera
    exposure: float | None
    clipped: int
    nonfinite: int
    inputs: tuple[InputFile, ...] = ()
    lossy: bool = False
    outline: Bool[Tensor, "h w"] | None = None
    full: Bool[Tensor, "h w"] | None = None
    white: Float[Tensor, "3"] | None = None

    @property
    def of_bounds(self) -> Photograph | None:
        """What is known of clipped pixels, in the place of the others: their channels' least radiance, 0 where that is
        all that is known; None where there are none."""
        if self.full is None or self.white is None:
            return None
        least = torch.where(self.radiance >= self.white, self.white, 0.0)
        return replace(self, radiance=least, mask=self.full, full=None, white=None)


def known_exposure(exposure: float | None) -> float:
    """Pixel over what a photograph's radiance was read as; 1 where the exposure is left to the fit."""
    return 1.0 if exposure is None else exposure


def read_photograph(spec: PhotographSpec, scene_file: str | Path, index: int = 0) -> Photograph:
    """Read the image and mask of one photograph.

    Args:
        spec: its table in the scene file.
        scene_file, index: where that table stands, for the error's sentence.

    Raises:
        InputError: a file is missing or unreadable, the mask's size is not the image's, or no pixel is left, or no
            light in those that are.
    """
    seen = expose(spec)
    radiance, finite, clipped = seen.radiance, seen.finite, seen.clipped
    field = f"photographs[{index}]"
    inside = torch.ones(radiance.shape[:2], dtype=torch.bool)
    outlines = []
    if seen.alpha is not None:
        inside &= seen.alpha >= COVERED
        if not bool((seen.alpha >= COVERED).all()):  # opaque throughout, it carries no outline
            outlines.append(seen.alpha >= 0.5)
    if spec.mask is not None:
        outlines.append(_mask(spec.mask, radiance.shape[:2], scene_file, f"{field}.mask"))
        inside &= ~dilated(~outlines[-1], 1)
    if not inside.any():
        if spec.mask is None:
            expected = "an alpha channel with fully covered pixels"
            raise InputError(scene_file, f"{field}.image", spec.image.name, expected)
        expected = "white pixels whose neighbours are white as well: 3 × 3 at least"
        raise InputError(scene_file, f"{field}.mask", spec.mask.name, expected)
    usable = inside & finite & ~clipped
    radiance = radiance if finite.all() else torch.where(finite[..., None], radiance, 0.0)
    wrong = _unusable(radiance, inside & finite, usable)
    if wrong is not None:
        raise InputError(scene_file, f"{field}.image", f"{spec.image.name}{wrong[0]}", wrong[1])
    height, width = inside.shape
    _require_proportions(spec.camera.lens, width, height, (scene_file, field))
    full = None
    if seen.white is not None:
        full = inside & finite & clipped & (radiance >= seen.white).any(-1)
    bounded = full is not None and bool(full.any())
    return Photograph(
        name=spec.image.stem,
        radiance=radiance,
        mask=usable,
        camera=camera_of(spec.camera, width, height),
        exposure=seen.exposure,
        clipped=int((inside & clipped).sum()),
        nonfinite=int((inside & ~finite).sum()),
        inputs=_inputs(spec),
        lossy=any(path.suffix.lower() in LOSSY for path in spec.images or (spec.image,)),
        outline=torch.stack(outlines).all(0) if outlines else None,
        full=full if bounded else None,
        white=seen.white if bounded else None,
    )


def _require_proportions(lens: LensSpec | None, width: int, height: int, place: tuple[str | Path, str]) -> None:
    """Raises InputError where a photograph was rotated or cropped since its lens was measured."""
    if lens is not None and abs(math.log(width * lens.height / (height * lens.width))) > PROPORTIONS:
        found = f"for {lens.width:g} × {lens.height:g} pixels"
        expected = f"intrinsics for the proportions of the photograph, {width} × {height}: was it turned, or cropped?"
        raise InputError(place[0], f"{place[1]}.camera.lens", found, expected)


def _inputs(spec: PhotographSpec) -> tuple[InputFile, ...]:
    """Image and mask; the system still has them in memory, so soon after they were read."""
    return tuple(InputFile(path=str(path), sha256=sha256_of(path)) for path in spec.files)


def _unusable(
    radiance: Float[Tensor, "h w 3"], finite: Bool[Tensor, "h w"], usable: Bool[Tensor, "h w"]
) -> tuple[str, str] | None:
    """What a photograph without anything to fit is, behind its name, and what was expected; None for a good one."""
    if not finite.any():
        return ", NaN or infinite throughout", "numbers inside the mask; export the image or set the mask anew"
    if not usable.any():
        return ", clipped throughout", "at least one covered pixel that is finite and not clipped; expose less"
    brightest = float(radiance.amax(-1)[usable].max())
    if brightest <= 0:
        return ", black inside the mask", "light on the object: values above 0; check mask and image"
    if not FAINTEST <= brightest <= BRIGHTEST:
        expected = f"light on the object of {FAINTEST:g} to {BRIGHTEST:g}; check the image and its exposure"
        return f" with a radiance of {brightest:.3g} at the brightest", expected
    return None


def _mask(path: Path, size: torch.Size, scene_file: str | Path, field: str) -> Bool[Tensor, "h w"]:
    """White pixels of a mask file; a drawn border may be half covered, so that those beside black ones are not used."""
    white = torch.from_numpy(read_image(path, "linear").radiance).mean(-1) > 0.5
    if white.shape != size:
        found = f"{path.name} with {white.shape[1]} × {white.shape[0]} pixels"
        raise InputError(scene_file, field, found, f"the photograph's {size[1]} × {size[0]} pixels")
    return white
