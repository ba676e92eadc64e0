"""The light of a perfect mirror: that of the mirrored view, without any lobe around it."""

from __future__ import annotations

import torch

from renderer import latlong, reflectance_basis
from renderer.environment import Environment
from renderer.footprint import STRATA, Places, filled
from renderer.gbuffer import GBuffer
from renderer.transport import LightTable


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
    basis = reflectance_basis.basis(cos_v.to(radiance), degree)
    light = torch.einsum("bpr,prc->pbc", basis, radiance) / cos_v.shape[1]
    return LightTable(light[None, None].expand(2, 1, *light.shape), alpha * 0.999, alpha * 1.001, "log")
