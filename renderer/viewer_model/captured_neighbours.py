"""What stands around each object of a model, as a cubemap of its own: radiance, and the depth that sharpens it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.renderer.environment import cubemap
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer, tracer

NEVER_SKY = 1 - 2.0**-24  # the greatest depth of a surface: the largest float32 below 1
MOST_SHELLS = 64  # inner sides, one behind the other, that a ray is followed through
Shader = Callable[[GBuffer], Float[Tensor, "*p 3"]]


@dataclasses.dataclass(frozen=True)
class Viewpoint:
    """Where an object sees its neighbours from.

    Attributes:
        centre: of the object's bounding box.
        near: radius of its bounding sphere, half the box's diagonal.
    """

    centre: Float[Tensor, "3"]
    near: float


def capture(
    mesh: Mesh, parts: Collection[int], environment: Cubemap, shade: Shader, size: int
) -> tuple[Cubemap | None, ...]:
    """The other objects and the sky, as some objects of a mesh see them [thesis 3.1.1; MODEL.md 3.3].

    Rays go from the object's viewpoint through the centres of texels; a texel of the sky holds the environment's
    cubemap as it is looked up there. The fourth channel is d = 1 - near/D in [0, 1), D the distance from the centre
    to the surface; 1 for the sky. Surfaces seen from inside are looked through: the centre of a shell's bounding box
    often lies within the thing that it holds, whose inner side no picture shows.

    Args:
        mesh: of several objects; of one, there is nothing to see.
        parts: for which of them to capture.
        environment: the far one.
        shade: radiance of the surfaces that are seen, under whatever light.
        size: texels along a face.

    Returns:
        for each of `mesh.part_names` a cubemap of four channels, float32; None where there is none.
    """
    none = dict.fromkeys(range(len(mesh.part_names)))
    if mesh.part is None or len(np.unique(mesh.part)) < 2:
        return tuple(none.values())
    seen = {part: _captured(mesh, mesh.part == part, environment, shade, size) for part in parts}
    return tuple({**none, **seen}.values())


def viewpoint(vertices: Float[np.ndarray, "v 3"]) -> Viewpoint:
    """Where an object of these vertices sees its neighbours from."""
    low, high = vertices.min(0), vertices.max(0)
    return Viewpoint(torch.from_numpy((low + high) / 2), float(np.linalg.norm(high - low)) / 2)


def depth(point: Viewpoint, positions: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p"]:
    """d = 1 - near/D of positions at the distance D, clamped to [0, 1): how much the blur shrinks [MODEL.md 3.3]."""
    distance = (positions - point.centre.to(positions)).norm(dim=-1)
    tiny = torch.finfo(distance.dtype).tiny
    return (1 - point.near / distance.clamp_min(tiny)).clamp(0, NEVER_SKY)


def _captured(mesh: Mesh, itself: Bool[np.ndarray, " f"], environment: Cubemap, shade: Shader, size: int) -> Cubemap:
    point = viewpoint(mesh.vertices[np.unique(mesh.faces[itself])])
    directions = cubemap.face_directions(size)
    rays = directions.reshape(-1, 3)
    surface = _outer_sides(tracer(_only(mesh, ~itself)), point, rays)
    sky = torch.cat([cubemap.lookup(environment, rays), torch.ones(len(rays), 1)], 1)
    met = surface.hit.nonzero()[:, 0]
    near = surface[met]
    things = torch.cat([shade(near), depth(point, near.position)[:, None]], 1).to(sky)
    return Cubemap(sky.index_put((met,), things).reshape(*directions.shape[:-1], 4))


def _outer_sides(trace: Tracer, point: Viewpoint, rays: Float[Tensor, "p 3"]) -> GBuffer:
    """The first outer side that each ray from the viewpoint meets; inner sides are looked through."""
    origins = point.centre.expand_as(rays).clone()
    for _ in range(MOST_SHELLS):
        surface = trace(origins, rays)
        inner = surface.hit & ((surface.geometric_normal * surface.view).sum(-1) <= 0)
        if not inner.any():
            break
        origins[inner] = surface.position[inner] + 1e-4 * point.near * rays[inner]
    return surface


def _only(mesh: Mesh, kept: Bool[np.ndarray, " f"]) -> Mesh:
    """Some faces of the mesh, as one that can be cast rays at."""
    assert mesh.part is not None
    return dataclasses.replace(mesh, faces=mesh.faces[kept], material=mesh.material[kept], part=mesh.part[kept])
