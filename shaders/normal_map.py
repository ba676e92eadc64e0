"""Tangent-space normal maps: the shading normal that a texel stands for."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize


def perturbed(
    normal: Float[Tensor, "*p 3"],
    tangent: Float[Tensor, "*p 3"],
    handedness: Float[Tensor, "*p 1"],
    texel: Float[Tensor, "*p 3"],
) -> Float[Tensor, "*p 3"]:
    """The surface's normal, perturbed by a normal map.

        n = normalise(normal)
        t = normalise(tangent - (n·tangent) n)
        b = handedness · (n × t)
        m = 2·texel - 1
        normalise(m_x t + m_y b + m_z n),   or n where that sum is exactly 0

    in which normalise(x) = x / max(|x|, 1e-12), so that a tangent of no direction (0, or along n) drops out and
    nothing becomes NaN.

    Args:
        normal: interpolated between vertices, world space; of any length.
        tangent: interpolated, along growing u; of any length and at any angle to the normal.
        handedness: interpolated, 1 where the map's v grows along n × t, -1 where it is mirrored; in between inside a
            triangle whose corners disagree, where the map fades out along v rather than jumps.
        texel: r, g, b of the map in [0, 1]: +Z out of the surface, +Y towards growing v, OpenGL's convention.

    Returns:
        unit normals, world space; 0 where `normal` and `tangent` are 0, as off the object. Differentiable.
    """
    n = normalize(normal, dim=-1)
    t = normalize(tangent - (n * tangent).sum(-1, keepdim=True) * n, dim=-1)
    b = handedness * torch.linalg.cross(n, t)
    x, y, z = (2 * texel - 1).split(1, dim=-1)
    turned = x * t + y * b + z * n
    return normalize(torch.where((turned == 0).all(-1, keepdim=True), n, turned), dim=-1)
