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

from collections.abc import Callable, Mapping
from dataclasses import fields
from types import MappingProxyType

from torch import Tensor

from fit_material.shaders.materials.glossy import Glossy
from fit_material.shaders.materials.material import AbstractMaterial
from fit_material.shaders.materials.matte import Matte
from fit_material.shaders.materials.metal import Metal

__all__ = ["TYPES", "TYPE_CODES", "Glossy", "Material", "Matte", "Metal", "made_of", "material_type"]

TYPE_CODES: Mapping[str, int] = MappingProxyType({"matte": 0, "glossy": 1, "metal": 2})
"""The number behind `Ns` for each type of material [thesis, table 3.1]."""

Material = Metal | Glossy | Matte

TYPES: tuple[type[Metal], type[Glossy], type[Matte]] = (Metal, Glossy, Matte)
"""All types of material."""

_BY_NAME: Mapping[str, type[Material]] = MappingProxyType({each.type: each for each in TYPES})


def material_type(name: str) -> type[AbstractMaterial]:
    """The type of material of that name: what can be asked of it before there is one."""
    return _BY_NAME[name]


def made_of(name: str, quantity: Callable[[str], Tensor]) -> Material:
    """The material of that type whose quantities are those of a function of their names."""
    made = _BY_NAME[name]
    return made(**{each.name: quantity(each.name) for each in fields(made)})
