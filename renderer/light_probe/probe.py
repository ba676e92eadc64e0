"""The surroundings from photographs of a mirror ball: what `fit-material probe` does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.replaceable import Replaceable
from fit_material.renderer.files.validation import check
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.light_probe.mirror_ball import Circle, find_ball, unwrapped
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.photographs.exposure import expose
from fit_material.renderer.scene.scene_file import PhotographSpec

MOST_CLIPPED = 0.9  # of the ball, of which the rest is no map
OUTSIDE = 0.1  # of the radius, by which a ball may be cut off at the picture's border
FAR = {"origin": [0, 0, 1], "target": [0, 0, 0], "projection": "orthographic"}  # which nothing here looks at


@dataclass(frozen=True)
class Probe:
    """What was found.

    Attributes:
        circle: the ball's outline.
        clipped: share of the ball's pixels that every exposure clips, or that lie beside such: lamps there are
            brighter than the map.
    """

    circle: Circle
    clipped: float


def probe(
    balls: Sequence[Path],
    out: Path,
    *,
    circle: Circle | None = None,
    surface: str = "Cr",
    encoding: str | None = None,
    exposure: float | Literal["exif"] | None = None,
    height: int = 256,
) -> Probe:
    """Write the surroundings that a mirror ball shows as a latitude-longitude EXR, whole or not at all.

    Args:
        balls: photographs of the ball by a fixed camera: one, or several exposures that are merged by their EXIF.
        out: where the map goes.
        circle: the ball's outline; found where left out.
        surface: the ball's metal, by its name in the catalogue.
        encoding: of the photographs, as in `scene.toml`.
        exposure: of a single photograph, pixel = exposure · radiance, or "exif"; 1 where left out.
        height: rows of the map.

    Raises:
        InputError: a photograph cannot be read, shows no ball or no light; an unknown metal; no place for the map, or
            that of a photograph.
    """
    if out.suffix.lower() != ".exr":
        raise InputError("-o", value=out, expected="a file that ends in .exr")
    Replaceable(tuple(balls)).require(out.parent, [out.name])
    if len(balls) > 1 and exposure not in (None, "exif"):
        raise InputError("--exposure", value=exposure, expected="one photograph; of several, EXIF says it")
    several = {"images": [str(ball.absolute()) for ball in balls]}
    single = {"image": str(balls[0].absolute()), "exposure": 1.0 if exposure is None else exposure}
    said = {**(several if len(balls) > 1 else single), **({} if encoding is None else {"encoding": encoding})}
    seen = expose(check(PhotographSpec, {**said, "camera": FAR}, Path("BALL")))
    chrome = metal(surface)
    usable = seen.finite & ~seen.clipped
    if not (seen.radiance[seen.finite] > 0).any():
        raise InputError(balls[0], expected="light on the ball, but it is black")
    radiance = torch.where(seen.finite[..., None], seen.radiance, 0.0)  # of clipped lamps a lower bound
    if circle is not None:
        _require_inside(circle, radiance.shape[1], radiance.shape[0])
    found = circle or find_ball(radiance.numpy(), balls[0])
    row, column = np.mgrid[: usable.shape[0], : usable.shape[1]] + 0.5
    ball = np.hypot(column - found.x, row - found.y) < found.radius
    clipped = float((~usable.numpy())[ball].mean()) if ball.any() else 1.0
    if clipped > MOST_CLIPPED:
        ball_at = f"{clipped:.0%} of the ball at --circle {found.x:.1f} {found.y:.1f} {found.radius:.1f} clipped"
        raise InputError(balls[0], value=ball_at, expected="a shorter exposure, or the ball's own --circle X Y RADIUS")
    n, k = (torch.tensor(values, dtype=torch.float64) for values in (chrome.n, chrome.k))
    write_exr(out, unwrapped(radiance.numpy(), found, n, k, height).numpy())
    return Probe(found, clipped)


def _require_inside(circle: Circle, width: int, height: int) -> None:
    """That the outline is a circle of which no more than a little lies outside the picture."""
    numbers = (circle.x, circle.y, circle.radius)
    beyond = OUTSIDE * circle.radius
    reach = circle.radius - beyond
    across = reach <= circle.x <= width - reach and reach <= circle.y <= height - reach
    if not (all(map(math.isfinite, numbers)) and circle.radius > 0 and across):
        value = " ".join(f"{each:g}" for each in numbers)
        raise InputError("--circle", value=value, expected=f"a circle inside the picture of {width} × {height} pixels")
