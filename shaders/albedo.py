"""Albedo of a material under uniform light."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.types import Material, Matte, Metal
from fit_material.shaders.optics import rough_plastic
from fit_material.shaders.optics.microfacets import Distribution
from fit_material.shaders.optics.quadrature import legendre

COSINES = 16  # of a Gauss–Legendre rule, by which these means are known to a ten-thousandth


def albedo(material: Material, distribution: Distribution) -> Float[Tensor, "*p 3"]:
    """Albedo of body and surface under uniform light, in [0, 1], float64.

        matte    color
        glossy   color · outcoupling · T̄² + R̄,   T̄ = 2 ∫ T(µ) µ dµ, and R̄ like that, of `shaders.optics.rough_plastic`
        metal    F0, above which the mean over all sides is by (1 - F0)/21 [Schlick 1994, eq. 15, integrated]

    Args:
        material: colours may be of many places, [*p, 3].
        distribution: of the microfacets.
    """
    if isinstance(material, Metal):
        return material.f0
    if isinstance(material, Matte):
        return material.color
    eta, alpha = rough_plastic.ior(material.reflectance[0]), material.roughness
    cosine, weight = legendre(COSINES)
    passed, mirrored = (
        2 * (share(cosine, eta, alpha, distribution) * cosine * weight).sum()
        for share in (rough_plastic.transmittance, rough_plastic.reflectance)
    )
    return material.color * passed**2 * rough_plastic.outcoupling(eta, alpha, distribution) + mirrored
