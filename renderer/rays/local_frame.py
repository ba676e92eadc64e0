"""Local frames of surface points, in which the view direction lies in the xz plane."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.rays.pixel_footprint import Rays

_STRAIGHT = 1e-9  # sine of a view straight down the normal, for which any tangent will do


@dataclass(frozen=True)
class Frames:
    """Per sample: cos_v, sin_v, and the world components of the tangent, bitangent and normal, each [p, s]."""

    cos_v: Float[Tensor, "p s"]
    sin_v: Float[Tensor, "p s"]
    axes: tuple[tuple[Tensor, Tensor, Tensor], ...]

    def to_local(self, x: Tensor, y: Tensor, z: Tensor) -> tuple[Tensor, ...]:
        return tuple(x * axis[0] + y * axis[1] + z * axis[2] for axis in self.axes)

    def to_world(self, x: Tensor, y: Tensor, z: Tensor) -> tuple[Tensor, ...]:
        tangent, bitangent, normal = self.axes
        return tuple(x * t + y * b + z * n for t, b, n in zip(tangent, bitangent, normal, strict=True))


def frames(surface: Rays, ray: Int[Tensor, "*p s"], dtype: torch.dtype = torch.float32) -> Frames:
    """Local frames in which the view lies in the xz plane, for the ray of the footprint that each sample takes."""
    pixel = torch.arange(len(surface.normal), device=ray.device)[:, None]
    normal, view, cos_v = surface.normal, surface.view, surface.n_dot_v
    tangent = view - cos_v[..., None] * normal
    # From float64: a cosine in float32 does not resolve the small angles that a narrow lobe resolves.
    sin_v = tangent.norm(dim=-1)
    tangent = tangent / sin_v[..., None].clamp_min(_STRAIGHT)
    straight = sin_v <= _STRAIGHT
    if straight.any():
        tangent[straight] = _any_tangent(normal[straight])
    bitangent = torch.linalg.cross(normal, tangent)
    axes = tuple(
        tuple(axis[pixel, ray, i].to(dtype).contiguous() for i in range(3)) for axis in (tangent, bitangent, normal)
    )
    return Frames(cos_v[pixel, ray].to(dtype).clamp(1e-6, 1), sin_v[pixel, ray].to(dtype), axes)  # type: ignore[arg-type]


def _any_tangent(normal: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
    """Perpendicular to the axis that is the least parallel to each normal."""
    axis = torch.nn.functional.one_hot(normal.abs().argmin(-1), 3).to(normal)
    return torch.nn.functional.normalize(torch.linalg.cross(normal, axis), dim=-1)
