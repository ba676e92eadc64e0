"""Fresnel reflectance of metals and dielectrics, and the coordinates in which a metal is described.

Symbols: `n + ik` complex refractive index relative to air, `cos_d` cosine between the light and the normal of the
reflecting facet (the half vector in a rough lobe, the surface normal for a mirror).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.shaders.optics.safe_sqrt import root


def schlick(cos_d: Float[Tensor, "*p"], f0: Float[Tensor, ...]) -> Float[Tensor, "*p"]:
    """Schlick's approximation of the Fresnel reflectance.

        F = f + (1-f)(1-c)⁵        [Schlick 1994, eq. 15; thesis 2.2]

    Args:
        cos_d: c, in [0, 1].
        f0: f, reflectance at normal incidence, in [0, 1]; broadcasts against `cos_d`.

    Returns:
        F, in [0, 1], unitless.
    """
    return f0 + (1 - f0) * (1 - cos_d) ** 5


def lazanyi(cos_d: Float[Tensor, "*p"], n: Float[Tensor, ...], k: Float[Tensor, ...]) -> Float[Tensor, "*p"]:
    """Lazányi's reflectance of a metal, as the thesis uses it (without the error-compensation term).

        F = [(n-1)² + 4n(1-c)⁵ + k²] / [(n+1)² + k²]        [Lazányi 2005, eq. 4; thesis 2.3]

    Equal to `schlick` with f = `normal_reflectance(n, k)`: it sees n and k through that one number only.

    Args:
        cos_d: c, in [0, 1].
        n, k: complex refractive index, n > 0, k >= 0; broadcast against `cos_d`.

    Returns:
        F, in [0, 1], unitless.
    """
    return ((n - 1) ** 2 + 4 * n * (1 - cos_d) ** 5 + k**2) / ((n + 1) ** 2 + k**2)


def conductor(cos_d: Float[Tensor, "*p"], n: Float[Tensor, ...], k: Float[Tensor, ...]) -> Float[Tensor, "*p"]:
    """Exact unpolarised reflectance of a conductor seen from air.

        w = a + ib = √((n + ik)² - s²),   s² = 1 - c²
        R_s = |w - c|² / |w + c|² = |(n + ik)² - 1|² / |w + c|⁴
        R_p = R_s · |wc - s²|² / |wc + s²|²
        F = ½ (R_s + R_p)        [Born & Wolf 1999, §14.2; Walter 2007 for k = 0]

    Args:
        cos_d: c, in [0, 1].
        n, k: complex refractive index, n > 0, k >= 0; broadcast against `cos_d`.

    Returns:
        F, in [0, 1], unitless; `normal_reflectance(n, k)` at c = 1, and 1 at c = 0 (0 everywhere for n = 1, k = 0).
    """
    facet = _Facet.of(cos_d, n, k)
    r_s = (((n - 1) / facet.s) ** 2 + (k / facet.s) ** 2) * ((n + 1) ** 2 + k**2)  # |w - c|² would cancel near air
    r_p = r_s * ((facet.a * cos_d - facet.sin2) ** 2 + (facet.b * cos_d) ** 2) / facet.p
    absorbed = facet.absorbed(cos_d)
    # 1 - F has no cancelling terms, so that F near 1 keeps its slope and never exceeds 1
    return torch.where(absorbed < 0.5, 1 - absorbed, 0.5 * (r_s + r_p))


def absorptance(cos_d: Float[Tensor, "*p"], n: Float[Tensor, ...], k: Float[Tensor, ...]) -> Float[Tensor, "*p"]:
    """1 - F of `conductor`, to the last digits where F is near 1.

        1 - F = 2ca/|w + c|² · [1 + (|w|² + s²) / |wc + s²|²]

    which is the mean of 1 - R_s and 1 - R_p, each over one denominator: a sum of positive terms.

    Args:
        cos_d, n, k: as `conductor` has them.

    Returns:
        1 - F, in [0, 1]; 0 at c = 0.
    """
    return _Facet.of(cos_d, n, k).absorbed(cos_d)


@dataclass(frozen=True)
class _Facet:
    """What both polarisations share: the parts of w, s², and the denominators |w + c|² and |wc + s²|², never 0."""

    a: Float[Tensor, "*p"]
    b: Float[Tensor, "*p"]
    sin2: Float[Tensor, "*p"]
    s: Float[Tensor, "*p"]
    p: Float[Tensor, "*p"]
    none: Bool[Tensor, "*p"]

    @staticmethod
    def of(cos_d: Float[Tensor, "*p"], n: Float[Tensor, ...], k: Float[Tensor, ...]) -> _Facet:
        sin2 = (1 - cos_d) * (1 + cos_d)
        # n² - s²: of its two forms the first keeps its digits where n → 0, the second where n → 1 and c → 0
        behind = torch.where(cos_d > 0.7, n**2 - sin2, (n - 1) * (n + 1) + cos_d**2)
        a, b = _principal_root(behind - k**2, 2 * n * k)
        s, p = (a + cos_d) ** 2 + b**2, (a * cos_d + sin2) ** 2 + (b * cos_d) ** 2
        return _Facet(a, b, sin2, torch.where(s > 0, s, 1.0), torch.where(p > 0, p, 1.0), s <= 0)

    def absorbed(self, cos_d: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
        """1 - F; all of it where there is no facet to reflect: n = 1, k = 0, c = 0."""
        both = 1 + (self.a**2 + self.b**2 + self.sin2) / self.p
        return torch.where(self.none, 1.0, 2 * cos_d * self.a / self.s * both)


def _principal_root(
    real: Float[Tensor, "*p"], imag: Float[Tensor, "*p"]
) -> tuple[Float[Tensor, "*p"], Float[Tensor, "*p"]]:
    """a, b >= 0 with (a + ib)² = real + i·imag, imag >= 0, without the cancellation of √((|z| ± real)/2)."""
    branch_point = (real == 0) & (imag == 0)  # total reflection begins here; its slope is infinite, so it is cut off
    away = torch.where(branch_point, 1.0, real)
    positive = real >= 0
    size = torch.where(positive, away, -away)  # |real| has the slope 0 at 0, which the root has not
    larger = (0.5 * (torch.hypot(away, imag) + size)).sqrt()
    smaller = imag / (2 * larger)
    larger = torch.where(branch_point, 0.0, larger)
    return torch.where(positive, larger, smaller), torch.where(positive, smaller, larger)


def dielectric(cos_d: Float[Tensor, "*p"], ior: Float[Tensor, ...]) -> Float[Tensor, "*p"]:
    """Exact unpolarised reflectance of a smooth dielectric seen from air.

        g² = η² - 1 + c²
        F  = ½ (g-c)²/(g+c)² [1 + (c(g+c)-1)²/(c(g-c)+1)²]        [Walter 2007, eq. 22]

    with g - c = (η² - 1)/(g + c), which does not cancel where η → 1.

    Args:
        cos_d: c, in [0, 1].
        ior: η, index of refraction relative to air, >= 1; broadcasts against `cos_d`.

    Returns:
        F, in [0, 1], unitless; ((η-1)/(η+1))² at c = 1, and 1 at c = 0 (0 everywhere for η = 1).
    """
    g = root((ior - 1) * (ior + 1) + cos_d**2)  # no total internal reflection from outside
    beside = torch.where(g + cos_d > 0, g + cos_d, 1.0)
    less = (ior - 1) * (ior + 1) / beside
    p = (cos_d * beside - 1) / (cos_d * less + 1)
    passed = transmittance(cos_d, ior)
    return torch.where(passed < 0.5, 1 - passed, 0.5 * (less / beside) ** 2 * (1 + p**2))


def transmittance(cos_d: Float[Tensor, "*p"], ior: Float[Tensor, ...]) -> Float[Tensor, "*p"]:
    """1 - F of `dielectric`, to the last digits where F is near 1.

        1 - F = 2 [c/(g + c) · g/(g + c) + c/p · g/p],   p = ηc + g/η

    by quotients, for squares of small cosines would underflow.

    Args:
        cos_d, ior: as `dielectric` has them.

    Returns:
        1 - F, in [0, 1]; 0 at c = 0, unless η = 1.
    """
    g = root((ior - 1) * (ior + 1) + cos_d**2)
    air = g + cos_d <= 0
    s, p = torch.where(air, 1.0, g + cos_d), torch.where(air, 1.0, ior * cos_d + g / ior)
    return torch.where(air, 1.0, 2 * ((cos_d / s) * (g / s) + (cos_d / p) * (g / p)))


def normal_reflectance(n: Float[Tensor, "*p"], k: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
    """F0 = [(n-1)² + k²] / [(n+1)² + k²], the reflectance at normal incidence, in [0, 1)."""
    return ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)


def index_limit(r: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
    """m = (1+√r)/(1-√r): a material of reflectivity r in [0, 1) has its n in [1/m, m], and no other.

    Written (1+√r)²/(1-r), whose subtraction is exact for r >= ½. The slope at r = 0, which is infinite, counts as 0.
    """
    return (1 + root(r)) ** 2 / (1 - r)


def extinction(r: Float[Tensor, "*p"], n: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
    """k of the material that has reflectivity r and refractive index n.

        k² = [r(n+1)² - (n-1)²]/(1-r) = (m - n)(n - 1/m)        [Gulbrandsen 2014, eq. 6, factored]

    The factored form keeps its digits where k → 0.

    Args:
        r: reflectivity at normal incidence, in [0, 1).
        n: refractive index in [1/m, m], m = `index_limit(r)`; outside it no k exists and 0 is returned.

    Returns:
        k >= 0.
    """
    limit = index_limit(r)
    return root((limit - n) * (n - 1 / limit))


def edge_tint(n: Float[Tensor, "*p"], k: Float[Tensor, "*p"]) -> tuple[Float[Tensor, "*p"], Float[Tensor, "*p"]]:
    """Gulbrandsen's artist-friendly coordinates of a metal.

        r = F0,   g = (n_max - n)/(n_max - n_min),   n_min = (1-r)/(1+r),   n_max = (1+√r)/(1-√r)
        [Gulbrandsen 2014, eqs. 3, 8-11]

    Args:
        n, k: complex refractive index, n > 0, k >= 0, not the air's own (1, 0).

    Returns:
        r, reflectivity in (0, 1), and g, edge tint: 0 where k = 0 and n > 1, 1 at n_min; slightly above 1 for the
        materials with n below n_min, which Gulbrandsen's interval leaves out.
    """
    r = normal_reflectance(n, k)
    n_min, n_max = (1 - r) / (1 + r), index_limit(r)
    return r, (n_max - n) / (n_max - n_min)


def from_edge_tint(r: Float[Tensor, "*p"], g: Float[Tensor, "*p"]) -> tuple[Float[Tensor, "*p"], Float[Tensor, "*p"]]:
    """n and k from reflectivity r in (0, 1) and edge tint g; the inverse of `edge_tint` [Gulbrandsen 2014, eq. 12]."""
    n = g * (1 - r) / (1 + r) + (1 - g) * index_limit(r)
    return n, extinction(r, n)
