"""A picture of the object through a photograph's camera, for people to look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer

LARGEST_SIDE = 320  # pixels shown along a side; of larger photographs every second, third … pixel is drawn


@dataclass(frozen=True)
class Picture:
    """What was drawn of a photograph's pixels.

    Attributes:
        radiance: [h, w, 3], float32; 0 outside the mask.
        mask: where the object was drawn.
    """

    radiance: Float[Tensor, "h w 3"]
    mask: Bool[Tensor, "h w"]


def draw(
    trace: Tracer,
    camera: Camera,
    wanted: Bool[Tensor, "h w"],
    step: int,
    footprint: int,
    shade: Callable[[GBuffer], Float[Tensor, "p 3"]],
) -> Picture:
    """Draw the wanted pixels that the object's front covers wholly.

    Args:
        trace: of the object.
        camera: the photograph's.
        wanted: which of every `step`-th pixel to draw, in both directions.
        step: distance between the pixels.
        footprint: rays along each side of a pixel.
        shade: from rays [p, k] inside each pixel to its radiance.
    """
    mask = wanted.clone()
    row, column = mask.nonzero().T
    surface = gbuffer.pixel_footprints(trace, camera, column * step, row * step, footprint)
    whole = surface.front.all(-1)
    mask[row[~whole], column[~whole]] = False
    radiance = torch.zeros(*mask.shape, 3)
    if whole.any():
        radiance[row[whole], column[whole]] = shade(surface[whole]).float().cpu()
    return Picture(radiance, mask)
