"""Which parts of a surface see the object itself instead of its surroundings."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.local_frame import frames
from fit_material.renderer.rays.pixel_footprint import Rays
from fit_material.shaders.optics import microfacets

# Alpha of the lobe that is looked through. The tails of a narrow one are wide, too: of Mitsuba's Spot in gold of alpha
# 0.05, n and k come out tens of standard errors off if only what a lobe of 0.1 shows of the object is left out.
WIDE = 0.4
ROUNDS = (4, 12, 48)  # directions tested in turn, of those whose earlier ones are all free
BLOCK = 1 << 14  # points at a time, which bounds the memory for their directions
OFF = 1e-4  # of the object's size, by which rays start off their own facet


def sees_itself(trace: Tracer, surface: GBuffer) -> Bool[Tensor, " p"]:
    """Whether the object meets any of 64 directions into which a rough lobe mirrors the view, from each point.

    Where one direction in a hundred is hidden, about every second point still passes, where one in twenty is, one point
    in thirty. Points of which the first directions are met are tested no further; and
    nobody is where none of these meets anything, as of all that is convex.

    Args:
        trace: of the object.
        surface: points on its front, [p].
    """
    found, surface = torch.zeros(len(surface.hit), dtype=torch.bool), lifted(surface)
    shift, rounds = _points(len(found))
    for points in rounds:
        free = ~found
        found[free] = _met(trace, surface[free], shift[:, free], points).any(-1)
        if not found.any():
            break
    return found


def hidden_share(trace: Tracer, surface: GBuffer) -> Float[Tensor, " p"]:
    """The share of the 64 directions of `sees_itself` that meet the object, in [0, 1]; all are tested."""
    surface, (shift, rounds) = lifted(surface), _points(len(surface.hit))
    return torch.cat([_met(trace, surface, shift, points) for points in rounds], 1).double().mean(-1)


def lifted(surface: GBuffer) -> GBuffer:
    """The points moved a little off the surface, so that their rays do not meet their own facet."""
    if not len(surface.hit):
        return surface
    extent = (surface.position.amax(0) - surface.position.amin(0)).norm() + surface.position.abs().max() / 10
    return replace(surface, position=surface.position + OFF * extent * surface.geometric_normal)


def _points(count: int) -> tuple[Float[Tensor, "2 p 1"], tuple[Float[Tensor, "2 1 s"], ...]]:
    """A shift for each of `count` places, and Sobol points for each round [Cranley & Patterson 1976]."""
    shift = torch.rand(2, count, 1, generator=torch.Generator().manual_seed(0))
    points = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(sum(ROUNDS)).T[:, None]
    return shift, points.split(ROUNDS, 2)


def _met(
    trace: Tracer, surface: GBuffer, shift: Float[Tensor, "2 p 1"], points: Float[Tensor, "2 1 s"]
) -> Bool[Tensor, "p s"]:
    """Which directions meet the object, some points of the surface at a time."""
    blocks = [slice(first, first + BLOCK) for first in range(0, max(1, len(surface.hit)), BLOCK)]
    return torch.cat([_met_at_once(trace, surface[part], *(points + shift[:, part]) % 1) for part in blocks])


def _met_at_once(
    trace: Tracer, surface: GBuffer, u1: Float[Tensor, "p s"], u2: Float[Tensor, "p s"]
) -> Bool[Tensor, "p s"]:
    """The same of all points.

    Those below the geometric horizon are not tested: the surface at the point itself would hide them.
    """
    directions = rough_reflections(surface, u1, u2)
    above = (directions * surface.geometric_normal[:, None]).sum(-1) > 1e-3
    origins = surface.position[:, None].expand_as(directions)
    met = torch.zeros_like(above)
    met[above] = trace(origins[above], directions[above]).hit
    return met


def rough_reflections(
    surface: GBuffer, u1: Float[Tensor, "p s"], u2: Float[Tensor, "p s"], alpha: float = WIDE
) -> Float[Tensor, "p s 3"]:
    """Directions into which a GGX lobe mirrors the view of points [p], by uniform numbers [Heitz 2018], float64."""
    rays = Rays(surface.normal[:, None], surface.view[:, None])
    frame = frames(rays, torch.zeros(u1.shape[1], dtype=torch.long))
    hx, hy, hz = microfacets.sample_visible_normals(frame.cos_v, alpha, u1, u2)
    cos_d = frame.sin_v * hx + frame.cos_v * hz
    world = frame.to_world(2 * cos_d * hx - frame.sin_v, 2 * cos_d * hy, 2 * cos_d * hz - frame.cos_v)
    return torch.stack(world, -1).double()


def cosine_directions(surface: GBuffer, u1: Float[Tensor, "p s"], u2: Float[Tensor, "p s"]) -> Float[Tensor, "p s 3"]:
    """Directions above points [p] in proportion to the cosine, by uniform numbers, float64.

    By Malley's method [Pharr et al. 2023, A.5.3].
    """
    radius, azimuth = u1.sqrt(), 2 * math.pi * u2
    frame = frames(Rays(surface.normal[:, None], surface.view[:, None]), torch.zeros(u1.shape[1], dtype=torch.long))
    world = frame.to_world(radius * azimuth.cos(), radius * azimuth.sin(), (1 - u1).sqrt())
    return torch.stack(world, -1).double()
