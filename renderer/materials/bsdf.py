"""BSDFs of Mitsuba for our materials, as dictionaries; Mitsuba itself is not needed for these."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

Channels = tuple[float, float, float]  # red, green, blue
Distribution = Literal["ggx", "beckmann"]

Bsdf = dict[str, Any]
"""A BSDF as Mitsuba's `load_dict` takes it."""


def conductor(n: Channels, k: Channels, alpha: float, distribution: Distribution = "ggx") -> Bsdf:
    """A metal as Mitsuba's `roughconductor`, or `conductor` where it is a mirror.

    Args:
        n, k: complex refractive index n + ik, red, green, blue; unitless.
        alpha: microfacet width, isotropic; 0 is a mirror.
        distribution: of the microfacets' normals.
    """
    index = {"eta": rgb(n), "k": rgb(k)}
    if alpha == 0:
        return {"type": "conductor", **index}
    return {"type": "roughconductor", **index, **_microfacets(alpha, distribution)}


def plastic(color: Channels, reflectance: float, alpha: float, distribution: Distribution = "ggx") -> Bsdf:
    """A diffuse body under a dielectric surface as Mitsuba's `roughplastic`, or `plastic` where it is smooth.

    Args:
        color: of the body, in [0, 1].
        reflectance: F0 of the surface at normal incidence, in (0, 1), made by its index of refraction.
        alpha, distribution: as `conductor`'s.
    """
    import torch

    from fit_material.shaders.optics.fresnel import index_limit

    index = float(index_limit(torch.tensor(reflectance, dtype=torch.float64)))  # F0 = ((η-1)/(η+1))²
    body = {"diffuse_reflectance": rgb(color), "int_ior": index, "ext_ior": 1.0, "nonlinear": False}
    if alpha == 0:
        return {"type": "plastic", **body}
    return {"type": "roughplastic", **body, **_microfacets(alpha, distribution)}


def diffuse(color: Channels) -> Bsdf:
    """A Lambertian surface of that albedo, in [0, 1], as Mitsuba's `diffuse`."""
    return {"type": "diffuse", "reflectance": rgb(color)}


def rgb(value: Sequence[float]) -> dict[str, Any]:
    """Three numbers of red, green and blue, which Mitsuba takes as they are."""
    return {"type": "rgb", "value": list(value)}


def _microfacets(alpha: float, distribution: Distribution) -> dict[str, Any]:
    return {"alpha": alpha, "distribution": distribution, "sample_visible": True}
