"""Types of materials as data: which quantities each has, and what files call it. No torch, as in `quantities`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar

from fit_material.shaders.materials.quantities import ALPHA, COLOR, F0, REFLECTANCE, ROUGHNESS, K, N, Quantity
from fit_material.shaders.registry.registry import Registry

MaterialType = str
"""Name of a type of material: a key of `KINDS`."""


@dataclass(frozen=True)
class Kind:
    """A type of material.

    Attributes:
        name: as files and the command line have it.
        code: number behind `Ns` in the thesis's MTL dialect [thesis, table 3.1]; None where that has none.
        noun: what a sentence calls it.
        stored: quantities that make it up, besides the width of its specular lobe.
        mirrors: whether it has a specular lobe, and so a width.
        has_body: whether it has a diffuse lobe.
        derived: quantities that follow from those that make it up.
        same_as: derived quantities that are another one by a second name.
    """

    name: MaterialType
    code: int | None
    noun: str
    stored: tuple[Quantity, ...]
    mirrors: bool
    has_body: bool
    derived: tuple[Quantity, ...] = ()
    same_as: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All that a material of this type has, whichever lobe it is seen by."""
        return (*self.stored, *self.derived, *((ALPHA, ROUGHNESS) if self.mirrors else ()))


class OfKind:
    """What belongs to a type of material, which each class that can be made sets.

    Attributes:
        kind: the type, as data.
        name: the type's name.
    """

    kind: ClassVar[Kind]
    name: ClassVar[MaterialType]

    def __init_subclass__(cls) -> None:
        if hasattr(cls, "kind"):  # not an interface
            cls.name = cls.kind.name

    @property
    def type(self) -> MaterialType:
        """Name of the type."""
        return self.kind.name

    @property
    def mirrors(self) -> bool:
        """Whether it has a specular lobe."""
        return self.kind.mirrors

    @property
    def has_body(self) -> bool:
        """Whether it has a diffuse lobe."""
        return self.kind.has_body


METAL = Kind("metal", 2, "a metal", (N, K), mirrors=True, has_body=False, derived=(F0,))
GLOSSY = Kind(
    "glossy",
    1,
    "glossy",
    (COLOR, REFLECTANCE),
    mirrors=True,
    has_body=True,
    derived=(F0,),
    same_as=MappingProxyType({F0.name: REFLECTANCE.name}),
)
MATTE = Kind("matte", 0, "matte", (COLOR, REFLECTANCE), mirrors=False, has_body=True)

KINDS = Registry(METAL, GLOSSY, MATTE)
"""All types of material."""

NAMES = tuple(KINDS)
"""Their names, of the program's own alone: for the command line, which is read once."""


def type_codes() -> dict[str, int]:
    """The number behind `Ns` for each type of material [thesis, table 3.1]."""
    return {kind.name: kind.code for kind in KINDS.values() if kind.code is not None}
