"""Pixels' rays in the order in which a compiled kernel fetches them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.rays.local_frame import frames as frames_of
from fit_material.renderer.rays.pixel_footprint import Rays


@dataclass(frozen=True)
class PackedRays:
    """Pixels' rays as a kernel takes them.

    Attributes:
        frames: of each ray, by `packed_frames`.
        mean: the same of all of a pixel's together.
        tilt: of `Rays`.
    """

    frames: Float[Tensor, "p k 8"]
    mean: Float[Tensor, "p 8"]
    tilt: Float[Tensor, " p"]


def packed(rays: Rays) -> PackedRays:
    """The rays, packed."""
    return PackedRays(packed_frames(rays), packed_frames(rays.mean)[:, 0], rays.tilt)


def packed_frames(surface: Rays) -> Float[Tensor, "p k 8"]:
    """Of each ray its tangent, sin_v, normal, cos_v: twice the four numbers that a kernel fetches at once."""
    rays = torch.arange(surface.normal.shape[1])
    frame = frames_of(surface, rays)
    tangent, _, normal = frame.axes
    return torch.stack([*tangent, frame.sin_v, *normal, frame.cos_v], -1)
