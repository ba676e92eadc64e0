"""A picture of the object through a photograph's camera, for people to look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from renderer import gbuffer
from renderer.camera import Camera
from renderer.gbuffer import GBuffer, Tracer

LARGEST_SIDE = 320  # pixels shown along a side; of larger photographs every second, third … pixel is drawn


@dataclass(frozen=True)
class Picture:
    """Every `step`-th pixel of a photograph, in both directions.

    Attributes:
        radiance: [h, w, 3], float32; 0 outside the mask.
        mask: where the object was drawn.
        step: distance between drawn pixels.
    """

    radiance: Float[Tensor, "h w 3"]
    mask: Bool[Tensor, "h w"]
    step: int


def draw(
    trace: Tracer,
    camera: Camera,
    wanted: Bool[Tensor, "height width"],
    footprint: int,
    shade: Callable[[GBuffer], Float[Tensor, "p 3"]],
) -> Picture:
    """Draw the wanted pixels that the object's front covers wholly.

    Args:
        trace: of the object.
        camera: the photograph's.
        wanted: pixels to draw.
        footprint: rays along each side of a pixel.
        shade: from rays [p, k] inside each pixel to its radiance.
    """
    step = -(-max(wanted.shape) // LARGEST_SIDE)
    mask = wanted[::step, ::step].clone()
    row, column = mask.nonzero().T
    surface = gbuffer.pixel_footprints(trace, camera, column * step, row * step, footprint)
    whole = surface.front.all(-1)
    mask[row[~whole], column[~whole]] = False
    radiance = torch.zeros(*mask.shape, 3)
    if whole.any():
        radiance[row[whole], column[whole]] = shade(surface[whole]).float().cpu()
    return Picture(radiance, mask, step)
