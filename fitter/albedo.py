"""How much of the light that falls on a material from all sides it sends back."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from shaders import plastic
from shaders.lobe import Distribution
from shaders.materials import Material, Matte, Metal

COSINES = 16  # of a Gauss–Legendre rule, by which these means are known to a ten-thousandth


def albedo(material: Material, distribution: Distribution) -> Float[Tensor, "*p 3"]:
    """The share of even light that a body and its surface send back, in [0, 1], float64.

        matte    color
        glossy   color · outcoupling · T̄² + R̄,   T̄ = 2 ∫ T(µ) µ dµ, and R̄ like that, of `shaders.plastic`
        metal    F0, above which the mean over all sides is by (1 - F0)/21 [Schlick 1994, eq. 15, integrated]

    Args:
        material: colours may be of many places, [*p, 3].
        distribution: of the microfacets.
    """
    if isinstance(material, Metal):
        return material.f0
    if isinstance(material, Matte):
        return material.color
    eta, alpha = plastic.ior(material.reflectance[0]), material.roughness
    node, weight = (torch.from_numpy(each) for each in np.polynomial.legendre.leggauss(COSINES))
    cosine = (node + 1) / 2
    passed, mirrored = (
        (share(cosine, eta, alpha, distribution) * cosine * weight).sum()
        for share in (plastic.transmittance, plastic.reflectance)
    )
    return material.color * passed**2 * plastic.outcoupling(eta, alpha, distribution) + mirrored
