"""Relief finer than the mesh: normals that a normal map turns, wherever rays meet the surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.images.textures import Texture, lookup
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.shaders.normal_map import perturbed


def with_relief(trace: Tracer, maps: Mapping[int, Texture]) -> Tracer:
    """The tracer of a mesh under normal maps.

    Args:
        trace: of the mesh, which has tangents: vertex normals and texture coordinates.
        maps: by the index of the material.
    """
    if not maps:
        return trace

    def traced(origins: Float[Tensor, "p 3"], directions: Float[Tensor, "p 3"]) -> GBuffer:
        surface = trace(origins, directions)
        normal = surface.normal.clone()
        for material, texture in maps.items():
            own = surface.hit & (surface.material == material)
            tangent, handedness = surface.tangent[own].split([3, 1], dim=-1)
            texel = lookup(texture, surface.uv[own]).to(normal)
            normal[own] = perturbed(normal[own], tangent, handedness, texel)
        return replace(surface, normal=normal)

    return traced
