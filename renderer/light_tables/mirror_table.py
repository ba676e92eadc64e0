"""The light of a perfect mirror: that of the mirrored view, without any lobe around it."""

from __future__ import annotations

import torch

from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.light_sampling import fresnel_basis
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.pixel_footprint import STRATA, Places, filled


def mirror_table(surface: GBuffer, environment: Environment, alpha: float, degree: int, seed: int) -> LightTable:
    """The light of the mirrored view itself, one lookup for each of a pixel's rays: that of a perfect mirror.

    Args:
        surface: [p, k] rays inside each of p pixels.
        environment: the light, on the CPU.
        alpha: the roughness that the table passes for.
        degree: number of functions in the reflectance basis.
        seed: of the places of the rays within their pixels.

    Returns:
        a table of one level, whose two halves are equal.
    """
    rays = filled(surface, Places.draw(torch.arange(len(surface.hit)), STRATA[0], seed)[:])
    cos_v = rays.n_dot_v
    towards = (2 * cos_v[..., None] * rays.normal - rays.view).to(environment.radiance)
    radiance = latlong.lookup(latlong.of(environment), *towards.unbind(-1))
    basis = fresnel_basis.basis(cos_v.to(radiance), degree)
    light = torch.einsum("bpr,prc->pbc", basis, radiance) / cos_v.shape[1]
    return LightTable(light[None, None].expand(2, 1, *light.shape), alpha * 0.999, alpha * 1.001, "log")
