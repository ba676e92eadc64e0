"""Integrals over microfacet normals, by quadrature and in numpy only: what sampled lobes are judged by."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Array = np.ndarray


def normals(alpha: float, distribution: str, polar: int = 200, azimuths: int = 240) -> tuple[Array, Array, Array]:
    """Microfacet normals in terms of the slope s = tan θ/α = x/(1-x), with Gauss–Legendre nodes x and even azimuths.

    Returns:
        cos θ [polar, 1], cos φ [azimuths], and weights [polar, 1] of D cos θ dω; for a whole turn their sum is 1.
        GGX: D cos θ dω = 2s/(1+s²)² ds dφ/2π; Beckmann: 2s exp(-s²) ds dφ/2π [Walter 2007, eqs. 25, 33].
    """
    x, weight = np.polynomial.legendre.leggauss(polar)
    x, weight = (x + 1) / 2, weight / 2
    s = x / (1 - x)
    density = 2 * s / (1 + s**2) ** 2 if distribution == "ggx" else 2 * s * np.exp(-(s**2))
    phi = 2 * math.pi * (np.arange(azimuths) + 0.5) / azimuths
    return (
        1 / np.sqrt(1 + (alpha * s[:, None]) ** 2),
        np.cos(phi),
        (density * weight / (1 - x) ** 2 / azimuths)[:, None],
    )


def masking(cos: Float[Array, "..."], alpha: float, distribution: str) -> Float[Array, "..."]:
    """Smith's G1 from Λ [Heitz 2014], for Beckmann in the rational form [Walter 2007]; 0 below the horizon."""
    tangent = np.sqrt(np.maximum(1 - cos**2, 1e-30)) / np.maximum(cos, 1e-30)
    if distribution == "ggx":
        g1 = 1 / (1 + (np.sqrt(1 + (alpha * tangent) ** 2) - 1) / 2)
    else:
        a = np.minimum(1 / (alpha * tangent), 1e3)
        g1 = np.where(a < 1.6, (3.535 * a + 2.181 * a**2) / (1 + 2.276 * a + 2.577 * a**2), 1.0)
    return np.where(cos > 0, g1, 0.0)


def albedo(
    cos_v: float,
    alpha: float,
    distribution: str,
    reflectance: Callable[[Array], Array] = np.ones_like,
) -> float:
    """Share of constant light that is reflected once: ∫ D G1(v) G1(l) F(v·h) max(0, v·h)/cos_v dω_h, with
    dω_l = 4 (v·h) dω_h put in for the light's solid angle."""
    cos_h, cos_phi, weight = normals(alpha, distribution)
    sin_h = np.sqrt(1 - cos_h**2)
    cos_d = np.maximum(0, math.sqrt(1 - cos_v**2) * sin_h * cos_phi + cos_v * cos_h)
    shadowing = masking(2 * cos_d * cos_h - cos_v, alpha, distribution)
    seen = masking(np.array(cos_v), alpha, distribution) * cos_d / (cos_v * cos_h)
    return float((weight * seen * shadowing * reflectance(cos_d)).sum())
