"""Fresnel reflectance of metals and dielectrics, and the coordinates in which a metal is described.

Symbols: `n + ik` complex refractive index relative to air, `cos_d` cosine between the light and the normal of the
reflecting facet (the half vector in a rough lobe, the surface normal for a mirror).
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


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

        a + ib = √((n + ik)² - s²),   s² = 1 - c²
        R_s = [(a-c)² + b²] / [(a+c)² + b²]
        R_p = R_s · [(ac-s²)² + b²c²] / [(ac+s²)² + b²c²]
        F = ½ (R_s + R_p)        [Born & Wolf 1999, §14.2; Walter 2007 for k = 0]

    Args:
        cos_d: c, in [0, 1].
        n, k: complex refractive index, n > 0, k >= 0; broadcast against `cos_d`.

    Returns:
        F, in [0, 1], unitless; `normal_reflectance(n, k)` at c = 1, and 1 at c = 0 (0 everywhere for n = 1, k = 0).
    """
    sin2 = (1 - cos_d) * (1 + cos_d)
    a, b = _principal_root((n - 1) * (n + 1) + cos_d**2 - k**2, 2 * n * k)  # n² - k² - s², exact where n → 1
    tiny = torch.finfo(a.dtype).tiny  # only n = 1, k = 0, c = 0 has no facet to reflect: 0/0 becomes 0
    r_s = ((a - cos_d) ** 2 + b**2) / ((a + cos_d) ** 2 + b**2).clamp_min(tiny)
    bc2 = (b * cos_d) ** 2
    r_p = r_s * ((a * cos_d - sin2) ** 2 + bc2) / ((a * cos_d + sin2) ** 2 + bc2)
    return 0.5 * (r_s + r_p)


def _principal_root(
    real: Float[Tensor, "*p"], imag: Float[Tensor, "*p"]
) -> tuple[Float[Tensor, "*p"], Float[Tensor, "*p"]]:
    """a, b >= 0 with (a + ib)² = real + i·imag, imag >= 0, without the cancellation of √((|z| ± real)/2)."""
    branch_point = (real == 0) & (imag == 0)  # total reflection begins here; its slope is infinite, so it is cut off
    away = torch.where(branch_point, 1.0, real)
    larger = (0.5 * (torch.hypot(away, imag) + away.abs())).sqrt()
    smaller = imag / (2 * larger)
    larger = torch.where(branch_point, 0.0, larger)
    positive = real >= 0
    return torch.where(positive, larger, smaller), torch.where(positive, smaller, larger)


def dielectric(cos_d: Float[Tensor, "*p"], ior: Float[Tensor, ...]) -> Float[Tensor, "*p"]:
    """Exact unpolarised reflectance of a smooth dielectric seen from air.

        g² = η² - 1 + c²
        F  = ½ (g-c)²/(g+c)² [1 + (c(g+c)-1)²/(c(g-c)+1)²]        [Walter 2007, eq. 22]

    Args:
        cos_d: c, in [0, 1].
        ior: η, index of refraction relative to air, > 1; broadcasts against `cos_d`.

    Returns:
        F, in [0, 1], unitless; ((η-1)/(η+1))² at c = 1, and 1 at c = 0.
    """
    g = ((ior - 1) * (ior + 1) + cos_d**2).sqrt()  # > 0 because ior > 1: no total internal reflection
    s = (g - cos_d) / (g + cos_d)
    p = (cos_d * (g + cos_d) - 1) / (cos_d * (g - cos_d) + 1)
    return 0.5 * s**2 * (1 + p**2)


def normal_reflectance(n: Float[Tensor, "*p"], k: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
    """F0 = [(n-1)² + k²] / [(n+1)² + k²], the reflectance at normal incidence, in [0, 1)."""
    return ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)


def index_limit(r: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
    """m = (1+√r)/(1-√r): a material of reflectivity r in [0, 1) has its n in [1/m, m], and no other."""
    root = r.sqrt()
    return (1 + root) / (1 - root)


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
    return ((limit - n) * (n - 1 / limit)).clamp_min(0).sqrt()


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
