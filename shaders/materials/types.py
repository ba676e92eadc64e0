"""The types of material as tensors, by name; `kinds` has them as data, `quantities` what their numbers are.

Colours are linear Rec. 709. [thesis 3.2, tables 3.1 and 3.2; MODEL.md 4, 5]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from torch import Tensor

from fit_material.shaders.materials.glossy import Glossy
from fit_material.shaders.materials.material import AbstractMaterial
from fit_material.shaders.materials.matte import Matte
from fit_material.shaders.materials.metal import Metal
from fit_material.shaders.materials.quantities import Quantity
from fit_material.shaders.materials.widths import Width
from fit_material.shaders.registry.registry import Registry

__all__ = ["TYPES", "Glossy", "Material", "Matte", "Metal", "made_of"]

Material: TypeAlias = AbstractMaterial

TYPES: Registry[type[AbstractMaterial]] = Registry(Metal, Glossy, Matte)
"""All types of material."""


def made_of(name: str, quantity: Callable[[Quantity], Tensor], width: Callable[[], Width]) -> Material:
    """The material of that type whose quantities are those of a function.

    Args:
        quantity: computes one of `Kind.stored`.
        width: computes the width of its specular lobe; not called of a type that has none.
    """
    made = TYPES[name]
    parts: dict[str, Any] = {each.name: quantity(each) for each in made.kind.stored}
    if made.kind.mirrors:
        parts["width"] = width()
    return made(**parts)
