"""The three materials of the thesis, and the words that files and shaders use for their parameters.

    name         symbol   unit       range     MTL key (metal, glossy, matte)
    n            n        –          > 0       Kd  –   –
    k            k        –          >= 0      Ka  –   –
    color        –        –          [0, 1]    –   Kd  Kd
    reflectance  f        –          [0, 1]    –   Ka  Ka
    roughness    ρ        –          >= 0      Ks  Ks  –        the thesis's blur radius, the viewer's number
    alpha        α        –          (0, 1]    –   –   –        microfacet width, Mitsuba's; ordinary MTL: Pr = √α

Colours are linear Rec. 709. [thesis 3.2, tables 3.1 and 3.2; MODEL.md 4, 5]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal

from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.optics import fresnel

TYPE_CODES: Mapping[str, int] = MappingProxyType({"matte": 0, "glossy": 1, "metal": 2})
"""The number behind `Ns` for each type of material [thesis, table 3.1]."""


@dataclass(frozen=True)
class Metal:
    """A metal: reflects, with colour, and does nothing else.

    Attributes:
        n, k: complex refractive index per channel, n > 0, k >= 0.
        roughness: blur radius ρ >= 0; where the lobe in use is a microfacet one, its width alpha.
    """

    n: Float[Tensor, "3"]
    k: Float[Tensor, "3"]
    roughness: Float[Tensor, ""]

    type: ClassVar[Literal["metal"]] = "metal"

    @property
    def f0(self) -> Float[Tensor, "3"]:
        """Reflectance at normal incidence, per channel."""
        return fresnel.normal_reflectance(self.n, self.k)


@dataclass(frozen=True)
class Glossy:
    """A dielectric: a diffuse body under a reflecting surface.

    Attributes:
        color: of the body, in [0, 1].
        reflectance: of the surface at normal incidence, in [0, 1].
        roughness: as a `Metal`'s.
    """

    color: Float[Tensor, "3"]
    reflectance: Float[Tensor, "3"]
    roughness: Float[Tensor, ""]

    type: ClassVar[Literal["glossy"]] = "glossy"


@dataclass(frozen=True)
class Matte:
    """A surface without reflections.

    Attributes:
        color: in [0, 1].
        reflectance: how much of it is seen from the front, in [0, 1]; at 1 the surface is Lambertian.
    """

    color: Float[Tensor, "3"]
    reflectance: Float[Tensor, "3"]

    type: ClassVar[Literal["matte"]] = "matte"


Material = Metal | Glossy | Matte
