"""Which parts of a surface see the object itself instead of its surroundings."""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from renderer.gbuffer import GBuffer, Tracer

CONE = math.radians(30)  # half angle around the mirrored view that is looked at
_SPOKES = 6


def sees_itself(trace: Tracer, surface: GBuffer) -> Bool[Tensor, " p"]:
    """Whether the object meets the mirrored view, or one of six directions 30° around it, from each point.

    Directions below the geometric horizon are not asked: the surface at the point itself would hide them.

    Args:
        trace: of the object.
        surface: points on its front, [p].
    """
    directions = _mirrored_cone(surface)
    above = (directions * surface.geometric_normal[:, None]).sum(-1) > 1e-3
    # Rays start a little off the surface, by a share of the object's size, so that they do not meet their own facet.
    extent = (surface.position.amax(0) - surface.position.amin(0)).norm()
    origins = (surface.position + 1e-4 * extent * surface.geometric_normal)[:, None].expand_as(directions)
    met = torch.zeros_like(above)
    met[above] = trace(origins[above], directions[above]).hit
    return met.any(-1)


def _mirrored_cone(surface: GBuffer) -> Float[Tensor, "p 7 3"]:
    r = 2 * surface.n_dot_v[:, None] * surface.normal - surface.view
    axis = torch.nn.functional.one_hot(r.abs().argmin(-1), 3).to(r)
    across = torch.nn.functional.normalize(torch.linalg.cross(r, axis), dim=-1)
    third = torch.linalg.cross(r, across)
    spokes = [
        math.cos(CONE) * r + math.sin(CONE) * (math.cos(turn) * across + math.sin(turn) * third)
        for turn in (2 * math.pi * i / _SPOKES for i in range(_SPOKES))
    ]
    return torch.stack([r, *spokes], 1)
