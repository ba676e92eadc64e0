"""The unknowns of a material: between physical quantities and the free vector that a solver may move anywhere."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.shaders.materials.material import AbstractMaterial
from fit_material.shaders.materials.widths import Microfacet, Width

M = TypeVar("M", bound=AbstractMaterial)

REACH = 30.0  # 1 - tanh² = 1e-25: float64 holds two more digits


@dataclass(frozen=True)
class Interval:
    """An open interval, on a linear or a logarithmic scale, as the image of the whole real line."""

    low: float
    high: float
    logarithmic: bool = False

    def value(self, free: Float[Tensor, "*q"]) -> Float[Tensor, "*q"]:
        """low + (high - low)·sigmoid(free), or the same between the logarithms."""
        share = torch.sigmoid(free)
        if self.logarithmic:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    def free(self, value: Float[Tensor, "*q"]) -> Float[Tensor, "*q"]:
        """The inverse of `value`."""
        if self.logarithmic:
            return torch.logit((value / self.low).log() / math.log(self.high / self.low))
        return torch.logit((value - self.low) / (self.high - self.low))

    def inside(self, value: Float[Tensor, "*q"]) -> Float[Tensor, "*q"]:
        """The value moved off the ends, where `free` would be infinite."""
        margin = 1e-3 * (self.high - self.low)
        return value.clamp(self.low + margin, self.high - margin)


@dataclass(frozen=True)
class WidthInterval(Interval):
    """An interval of the width of a specular lobe.

    Attributes:
        lobe: which width it is.
    """

    lobe: type[Width] = Microfacet

    @staticmethod
    def of(table: LightTable) -> WidthInterval:
        """The span of a light table."""
        return WidthInterval(table.low, table.high, table.scale == "log", table.lobe)

    def width(self, free: Float[Tensor, " 1 *q"]) -> Width:
        """The width of a free number."""
        return self.lobe(self.value(free[0]))

    def free_width(self, width: Width) -> Float[Tensor, "1"]:
        """The inverse of `width`, moved off the ends."""
        return self.free(self.inside(width.value))[None]


class Coordinates(ABC, Generic[M]):
    """A type of material as a function of a free vector, of which what comes after its own `size` numbers is not its.

    Attributes:
        width: the interval of the specular lobe's width; None where the material has no such lobe.
    """

    width: WidthInterval | None

    @property
    @abstractmethod
    def sizes(self) -> Mapping[str, int]:
        """Lengths of the parts of the free vector, by name, in their order; the width's is called "width"."""

    @cached_property
    def slices(self) -> Mapping[str, slice]:
        """Where each part lies in the free vector."""
        ends = list(itertools.accumulate(self.sizes.values(), initial=0))
        return {name: slice(*place) for name, place in zip(self.sizes, itertools.pairwise(ends), strict=True)}

    @property
    def size(self) -> int:
        """Length of the free vector."""
        return sum(self.sizes.values())

    @abstractmethod
    def material(self, x: Float[Tensor, " x"]) -> M:
        """The material of a free vector."""

    @abstractmethod
    def free(self, material: M) -> Float[Tensor, " x"]:
        """The free vector of a material; quantities at the ends of their domains are moved a little inside."""

    @property
    def sees_f0_only(self) -> bool:
        """Whether the reflectance in use is one that a metal's n and k enter through F0 alone [MODEL.md 1]."""
        return False

    def alternative_starts(self, x: Float[Tensor, " x"]) -> list[Float[Tensor, " x"]]:
        """Further starts, where the sum of squares may have several minima; none by default."""
        return []

    def prior(self, x: Float[Tensor, " x"]) -> Float[Tensor, " q"]:
        """Knowledge from before any photograph, as residuals of standard deviation 1; none by default."""
        return x[:0]


UNIT = Interval(0.0, 1.0)
