"""Pictures in the viewer's own model, by torch: the differentiable twin of the GL viewer."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment import cubemap
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.geometry.mesh import Mesh, Shape
from fit_material.renderer.images import textures
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.viewer_model.captured_neighbours import capture
from fit_material.renderer.viewer_model.model import Appearance, Model
from fit_material.renderer.viewer_model.viewer_light import VIEWER_FACE_SIZE, Surroundings
from fit_material.shaders.normal_map import perturbed
from fit_material.shaders.shade import EnvironmentLight, Illumination, Points, shade

_CHUNK = 1 << 14  # points at a time, whose 49 taps then take some hundred megabytes


def render(
    model: Model, camera: Camera, surroundings: Surroundings, *, neighbours: bool = True
) -> Float[Tensor, "h w 4"]:
    """The picture of a model, sampled at pixel centres.

    Args:
        model: mesh, materials and maps; computed in the dtype of its materials.
        camera: perspective or orthographic.
        surroundings: the light; looked up in float32.
        neighbours: each reflective object of several reflects the others [MODEL.md 3.3].

    Returns:
        radiance, linear Rec. 709, and coverage, 0 or 1; 0 0 0 0 beside the model.
    """
    return render_shape(model.mesh, model.appearances, camera, surroundings, neighbours=neighbours)


def render_shape(
    shape: Shape,
    appearances: Sequence[Appearance],
    camera: Camera,
    surroundings: Surroundings,
    *,
    neighbours: bool = True,
) -> Float[Tensor, "h w 4"]:
    """As `render`, for any shape: the sphere, too."""
    appearances = applicable(shape, appearances)
    lights = illuminations(shape, appearances, surroundings, neighbours=neighbours)
    surface = gbuffer.pixel_centres(gbuffer.tracer(shape), camera)
    radiance = shade_surface(surface, appearances, lights)
    return torch.cat([radiance, surface.hit[..., None].to(radiance)], -1)


def applicable(shape: Shape, appearances: Sequence[Appearance]) -> tuple[Appearance, ...]:
    """The appearances without the maps that the shape has no texture coordinates or tangents for."""
    if isinstance(shape, Mesh) and shape.uv is None:
        return tuple(Appearance(each.material) for each in appearances)
    if isinstance(shape, Mesh) and shape.normals is not None:
        return tuple(appearances)
    return tuple(Appearance(each.material, replace(each.maps, normal=None)) for each in appearances)


def illuminations(
    shape: Shape, appearances: Sequence[Appearance], surroundings: Surroundings, *, neighbours: bool = True
) -> tuple[Illumination, ...]:
    """The light that falls on each object of a shape, with what it sees of the others.

    Those others are lit by the far environment alone: there are no reflections of reflections.
    """
    if not isinstance(shape, Mesh):
        return (far_light(surroundings),)
    captured = _captured(shape, appearances, surroundings) if neighbours else [None] * len(shape.part_names)
    return tuple(far_light(surroundings) if each is None else near_light(surroundings, each) for each in captured)


def far_light(surroundings: Surroundings) -> EnvironmentLight:
    """Light of the far environment."""
    radiance = functools.partial(cubemap.lookup, surroundings.cubemap)
    return EnvironmentLight(radiance, surroundings.ambient, sources=surroundings.sources)


def near_light(surroundings: Surroundings, captured: Cubemap) -> EnvironmentLight:
    """Light in which the environment is what an object has captured, radiance and depth."""
    radiance, depth = (Cubemap(channels) for channels in captured.faces.split([3, 1], dim=-1))
    return EnvironmentLight(
        functools.partial(cubemap.lookup, radiance),
        surroundings.ambient,
        lambda directions: cubemap.lookup(depth, directions)[..., 0],
        surroundings.sources,
    )


def _captured(mesh: Mesh, appearances: Sequence[Appearance], surroundings: Surroundings) -> tuple[Cubemap | None, ...]:
    lights = [far_light(surroundings)] * len(mesh.part_names)
    shader = functools.partial(shade_surface, appearances=appearances, lights=lights)
    return capture(mesh, reflective_parts(mesh, appearances), surroundings.cubemap, shader, VIEWER_FACE_SIZE)


def reflective_parts(mesh: Mesh, appearances: Sequence[Appearance]) -> tuple[int, ...]:
    """The objects that have a face of a reflective material, metal or glossy."""
    if mesh.part is None:
        return ()
    reflective = np.array([each.material.mirrors for each in appearances])
    return tuple(np.unique(mesh.part[reflective[mesh.material]]).tolist())


def shade_surface(
    surface: GBuffer, appearances: Sequence[Appearance], lights: Sequence[Illumination]
) -> Float[Tensor, "*p 3"]:
    """Radiance of a surface towards the viewer, linear Rec. 709; 0 where no surface was hit.

    Args:
        surface: points, any leading shape.
        appearances: by `surface.material`.
        lights: by `surface.part`.

    Returns:
        in the dtype of the materials; differentiable in them and in the light, through cubemaps in reverse mode only
        (torch has no forward derivative of `grid_sample`).
    """
    flat = surface.reshape(-1)
    dtype = functools.reduce(torch.promote_types, (each.material.dtype for each in appearances))
    where, values = [torch.empty(0, dtype=torch.long)], [torch.empty(0, 3, dtype=dtype)]
    for m, part in itertools.product(range(len(appearances)), range(len(lights))):
        chosen = flat.hit & (flat.material == m) & (flat.part == part)
        for chunk in chosen.nonzero()[:, 0].split(_CHUNK):
            if len(chunk):
                where.append(chunk)
                seen = points(flat[chunk], appearances[m])
                values.append(shade(appearances[m].material, seen, lights[part]).to(dtype))
    shaded = torch.zeros(len(flat.hit), 3, dtype=dtype).index_put((torch.cat(where),), torch.cat(values))
    return shaded.reshape(*surface.hit.shape, 3)


def points(surface: GBuffer, appearance: Appearance) -> Points:
    """Inputs of the shading model of a surface with maps over it, in the material's dtype."""
    dtype, maps, uv = appearance.material.dtype, appearance.maps, surface.uv
    normal, view = surface.normal, surface.view
    if maps.normal is not None:
        tangent, handedness = surface.tangent.split([3, 1], dim=-1)
        normal = perturbed(normal, tangent, handedness, textures.lookup(maps.normal, uv).to(normal))
    openness = None if maps.ambient_occlusion is None else textures.lookup(maps.ambient_occlusion, uv)[..., :1]
    tint = None if maps.color is None else textures.lookup(maps.color, uv)
    return Points(
        normal.to(dtype),
        view.to(dtype),
        None if openness is None else openness.to(dtype),
        None if tint is None else tint.to(dtype),
        surface.position.to(dtype),
    )
