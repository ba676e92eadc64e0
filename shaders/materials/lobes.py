"""Lobes: the parts of a material's BRDF. Shading uses these, and never the type of the material."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

Factor = Callable[[Float[Tensor, "*p 1"]], Float[Tensor, "*p c"]]
"""A factor on light by a cosine, for one or three channels."""


@dataclass(frozen=True)
class Specular:
    """Specular lobe of microfacets: light that the surface mirrors, F · D G / (4 n·l n·v).

    Attributes:
        reflectance: Fresnel reflectance F, by the cosine between view and half vector.
        alpha: microfacet width.
    """

    reflectance: Factor
    alpha: Float[Tensor, ""]


@dataclass(frozen=True)
class Blurred:
    """Specular lobe as the thesis has it: F times the surroundings around the mirrored view, blurred.

    Attributes:
        reflectance: Fresnel reflectance F, by n·v.
        rho: the blur's radius ρ.
    """

    reflectance: Factor
    rho: Float[Tensor, ""]


@dataclass(frozen=True)
class Diffuse:
    """Diffuse lobe: light that a body scatters evenly, albedo/π · entering(n·l) · leaving(n·v).

    Attributes:
        albedo: of the body, per channel.
        entering: transmittance by n·l, on the way in.
        leaving: transmittance by n·v, on the way out.
    """

    albedo: Float[Tensor, "*p 3"]
    entering: Factor
    leaving: Factor


MicrofacetLobe = Specular | Diffuse
ThesisLobe = Blurred | Diffuse
