"""Lobes: what a material scatters light by. Whoever shades asks a material for these, and never for its type."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

Factor = Callable[[Float[Tensor, "*p 1"]], Float[Tensor, "*p c"]]
"""A factor on light by a cosine, for one or three channels."""


@dataclass(frozen=True)
class Specular:
    """Specular lobe: light that the surface mirrors, F · D G / (4 n·l n·v), or the thesis's blur under F.

    Attributes:
        reflectance: Fresnel reflectance F: by the cosine at the half vector of microfacets, by n·v of the blur.
        width: microfacet width alpha, or the blur's radius ρ.
    """

    reflectance: Factor
    width: Float[Tensor, ""]


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


Lobe = Specular | Diffuse
