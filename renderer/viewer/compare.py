"""Photographs beside or over the render: which pixels meet which, and by what factor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.cameras.undistortion import pinhole, rectified
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.photographs.exposure import expose
from fit_material.renderer.scene.scene_file import PhotographSpec, camera_of, read_scene
from fit_material.renderer.viewer.look import Comparison

DIFFERENCE_RANGE = 0.25
"""Exposed radiance by which the render differs where the difference is shown black or white; grey is none.

The difference is that of linear radiance, channel by channel, under the exposure chosen but before any tone mapping: a
tone curve would hide it in the lights and swell it in the shadows. More exposure shows smaller differences.
"""

WHOLE = 1 - 1e-5  # of a rectified pixel that lies between compared ones only, but for rounding
GAP = 4  # pixels between two pictures


@dataclass(frozen=True)
class Area:
    """A rectangle of a framebuffer in pixels, from its lower left corner."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class Photograph:
    """A photograph as it is laid over a picture.

    Attributes:
        name: the image file's name.
        radiance: linear Rec. 709, float32 [h, w, 3], finite; radiance times the exposure where that is to be fitted.
        compared: where its difference to a render is to be shown, [h, w].
        camera: where it was taken from.
        cut_out: it shows the object alone, so that the render's sky is none of its business.
        exposure_known: whether `radiance` is radiance; else it is that but for a factor.
    """

    name: str
    radiance: Float[np.ndarray, "h w 3"]
    compared: Bool[np.ndarray, "h w"]
    camera: Camera
    cut_out: bool
    exposure_known: bool


class Photographs:
    """The photographs of a scene file; each is read when it is looked at, since there may be hundreds.

    Attributes:
        cameras: of all photographs; their width and height are not known, and given as 1.

    Raises:
        InputError: as `renderer.scene.scene_file.read_scene`.
    """

    def __init__(self, scene: Path) -> None:
        self._scene = scene
        self._specs = read_scene(scene).photographs
        self._read: tuple[int, Photograph] | None = None
        self.cameras = [pinhole(camera_of(spec.camera, 1, 1)) for spec in self._specs]

    def __getitem__(self, index: int) -> Photograph:
        """One photograph.

        Raises:
            InputError: there is none of that number, or its image or mask cannot be read.
        """
        if not 0 <= index < len(self._specs):
            raise InputError("--view", value=index + 1, expected=f"1 to {len(self._specs)}, a photograph of the scene")
        if self._read is None or self._read[0] != index:
            self._read = index, read_photograph(self._specs[index], self._scene, index)
        return self._read[1]


def read_photograph(spec: PhotographSpec, scene: Path, index: int) -> Photograph:
    """Read a photograph and its mask, as a pinhole would have taken it: OpenGL draws no other lens.

    Pixels that are not finite become black and are not compared.

    Raises:
        InputError: a file is missing or unreadable, or the mask has another size.
    """
    seen = expose(spec)
    finite = seen.finite.numpy()
    height, width = finite.shape
    alpha = np.ones((height, width), np.float32) if seen.alpha is None else seen.alpha.numpy()
    white = alpha if spec.mask is None else read_image(spec.mask, "linear").radiance.mean(-1)
    if white.shape != alpha.shape:
        expected = f"{width} × {height} pixels, as its photograph"
        raise InputError(scene, f"photographs[{index}].mask", f"{white.shape[1]} × {white.shape[0]}", expected)
    known = seen.exposure is not None
    radiance = np.where(finite[..., None], seen.radiance.numpy(), 0)
    cut_out = seen.alpha is not None or spec.mask is not None
    compared = finite & (alpha >= 0.5) & (white >= 0.5)
    camera = camera_of(spec.camera, width, height)
    if camera.lens is not None:
        layers = torch.from_numpy(np.concatenate([radiance, compared[..., None]], -1, dtype=np.float32))
        straight = rectified(layers, camera).numpy()
        radiance, compared = straight[..., :3], straight[..., 3] >= WHOLE
    return Photograph(spec.image.name, radiance, compared, pinhole(camera), cut_out, known)


def areas(comparison: Comparison, width: int, height: int, camera: Camera) -> tuple[Area, ...]:
    """Where pictures stand in a framebuffer of `width` × `height`.

    Returns:
        One area, for the render and whatever is laid over it; under "beside" two, photograph and render. They have
        the proportions of the photograph's camera, but under "off", where the one area is the whole framebuffer.
    """
    whole = Area(0, 0, width, height)
    if comparison == "off":
        return (whole,)
    if comparison != "beside":
        return (_fitted(whole, camera),)
    columns, rows = max(1, (width - GAP) // 2), max(1, (height - GAP) // 2)
    left, right = Area(0, 0, columns, height), Area(width - columns, 0, columns, height)
    upper, lower = Area(0, height - rows, width, rows), Area(0, 0, width, rows)
    ways = [tuple(_fitted(area, camera) for area in way) for way in ((left, right), (upper, lower))]
    return max(ways, key=lambda way: way[0].width)


def exposure_factor(
    photograph: Float[np.ndarray, "*p 3"], rendered: Float[np.ndarray, "*p 3"], compared: Bool[np.ndarray, "*p"]
) -> float:
    """The factor from a photograph's values to radiance that brings it nearest to the render.

    The exposure s minimises Σ (photograph - s · rendered)², so that s = Σ photograph · rendered/Σ rendered²; the factor
    is 1/s. Where that is no positive number, because one of the two is black, it is 1.
    """
    values, radiance = photograph[compared].astype(np.float64), rendered[compared].astype(np.float64)
    both, alone = float((values * radiance).sum()), float((radiance**2).sum())
    return alone / both if both > 0 and alone > 0 else 1.0


def _fitted(area: Area, camera: Camera) -> Area:
    """The largest area of a camera's proportions in the middle of another."""
    scale = min(area.width / camera.width, area.height / camera.height)
    width = min(area.width, max(1, round(scale * camera.width)))
    height = min(area.height, max(1, round(scale * camera.height)))
    return Area(area.x + (area.width - width) // 2, area.y + (area.height - height) // 2, width, height)
