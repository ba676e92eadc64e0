"""Light that a surface receives from the object itself, estimated: surfaces are shaded as by the viewer.

One bounce, in the far surroundings' light as far as that arrives; more bounces add less. It
determines whether paths are worth tracing, and traces none.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.estimation.viewer_roughness import blur_like
from fit_material.fitter.forward.lighting import Lighting
from fit_material.renderer.light_tables.light_table import reflect
from fit_material.renderer.materials.textured_material import Appearance
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.self_visibility import cosine_directions, lifted, rough_reflections
from fit_material.renderer.viewer_model.shading import far_light, shade_surface
from fit_material.shaders.materials.fresnel_models import exact_reflectance
from fit_material.shaders.materials.types import Material
from fit_material.shaders.materials.widths import alpha_of

DIRECTIONS = 32


def returned_light(trace: Tracer, surface: GBuffer, lighting: Lighting, material: Material) -> Float[Tensor, "p 3"]:
    """Radiance that points [p] send to the viewer of light that came from the object, float64.

    Args:
        trace: of the object.
        surface: points on its front.
        lighting: the light.
        material: of all of it.
    """
    surface = lifted(surface)
    u1, u2 = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(DIRECTIONS).double().T
    u1, u2 = (each.expand(len(surface.hit), -1) for each in (u1, u2))
    found = torch.zeros(len(surface.hit), 3, dtype=torch.float64)
    if material.width is not None:
        mirrored = rough_reflections(surface, u1, u2, float(alpha_of(material.width)))
        reflectance = exact_reflectance(material, surface.n_dot_v[:, None].clamp(0, 1))
        found = found + reflectance * _from_itself(trace, surface, mirrored, lighting, material)
    if material.color is not None:
        above = cosine_directions(surface, u1, u2)
        found = found + material.color * _from_itself(trace, surface, above, lighting, material)
    return found


def _from_itself(
    trace: Tracer, surface: GBuffer, towards: Float[Tensor, "p s 3"], lighting: Lighting, material: Material
) -> Float[Tensor, "p 3"]:
    """Mean radiance from these directions, of which what does not meet the object counts as dark."""
    above = (towards * surface.geometric_normal[:, None]).sum(-1) > 0
    origins = surface.position[:, None].expand_as(towards)
    met = trace(origins[above], towards[above])
    shown = replace(met, hit=met.front, material=0 * met.material, part=0 * met.part)
    as_viewed = material if material.width is None else material.with_width(blur_like(material.width))
    shaded = shade_surface(shown, [Appearance(as_viewed)], [far_light(lighting.viewers)]).double()
    radiance = torch.zeros_like(towards)
    radiance[above] = shaded * ~_hidden(trace, shown, material)[:, None]
    return radiance.mean(1)


def _hidden(trace: Tracer, met: GBuffer, material: Material) -> Bool[Tensor, " p"]:
    """Whether the object hides what lights these points: what they mirror, or one direction above a diffuse body."""
    places = lifted(met)
    if not material.mirrors:
        u = torch.rand(2, len(met.hit), 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
        lit_from = cosine_directions(places, *u)[:, 0]
    else:
        lit_from = reflect(places)
    hidden = torch.zeros_like(met.hit)
    hidden[met.hit] = trace(places.position[met.hit], lit_from[met.hit]).hit
    return hidden
