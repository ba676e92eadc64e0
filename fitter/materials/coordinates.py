"""The unknowns of a material: between physical quantities and the free vector that a solver may move anywhere."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import softplus

from fit_material.shaders.materials.material import AbstractMaterial
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.optics import fresnel

M = TypeVar("M", bound=AbstractMaterial)

_REACH = 30.0  # 1 - tanh² = 1e-25: float64 holds two more digits
TINT_WIDTH = 1.5  # of artanh(log n / log m); the catalogue's metals lie within ±1
TINTS = (-1.0, -0.5, 0.0, 0.5)  # where metals lie, half the prior's width apart
_MOST_REFLECTIVE = 9.2  # F0 = 0.9999, which no metal exceeds; n and k stay below 1e5 where a fit runs into it


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


class Coordinates(ABC, Generic[M]):
    """A kind of material as a function of a free vector, of which what comes after its own `size` numbers is not its.

    Attributes:
        roughness: the interval of roughness; None where the material has none.
    """

    roughness: Interval | None

    @property
    @abstractmethod
    def size(self) -> int:
        """Length of the free vector."""

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

    def elsewhere(self, x: Float[Tensor, " x"]) -> list[Float[Tensor, " x"]]:
        """Further starts, where the sum of squares may have several minima; none by default."""
        return []

    def prior(self, x: Float[Tensor, " x"]) -> Float[Tensor, " q"]:
        """What is known before any photograph, as residuals of standard deviation 1; none by default."""
        return x[:0]


UNIT = Interval(0.0, 1.0)
MATTE_REFLECTANCE = Interval(0.0, 1.5)  # the Lambertian, 1, lies inside: at an end no error could be told


@dataclass(frozen=True)
class MetalCoordinates(Coordinates[Metal]):
    """The free vector of a metal: reflectivity per channel, tint per channel, roughness.

        F0 = sigmoid(x₀…₂),   n = m^tanh(x₃…₅),   m = (1+√F0)/(1-√F0),   roughness from x₆

    A material of reflectivity F0 has its n in [1/m, m] and every n there belongs to one k (`fresnel.extinction`),
    so that the free vector reaches every metal and nothing else. This is Gulbrandsen's pair of reflectivity and
    edge tint, with the tint measured in log n: real metals, whose edge tints crowd within 0.95…1, spread out.

    Attributes:
        roughness: the interval of roughness.
        tint: fixed x₃…₅ where the reflectance in use cannot see them; None where they are unknowns.
    """

    roughness: Interval
    tint: Float[Tensor, "3"] | None = None

    @property
    def size(self) -> int:
        return 7 if self.tint is None else 4

    @property
    def sees_f0_only(self) -> bool:
        return self.tint is not None

    def material(self, x: Float[Tensor, " x"]) -> Metal:
        """The metal of a free vector.

        k² = (m - n)(n - 1/m) is written with n = m^t as n² (m^(1-t) - 1)(1 - m^-(1+t)), 1 ± t = 2 sigmoid(±2x₃…₅):
        so k and its derivative keep their digits where n comes to its limits. `_REACH` ends what can be told apart.
        """
        reflectivity = x[:3].clamp(-_REACH, _MOST_REFLECTIVE)
        tint = (x[3:6] if self.tint is None else self.tint.to(x)).clamp(-_REACH, _REACH)
        log_limit = 2 * torch.log1p(torch.sigmoid(reflectivity).sqrt()) + softplus(reflectivity)
        n = (log_limit * torch.tanh(tint)).exp()
        above, below = (2 * log_limit * torch.sigmoid(side) for side in (-2 * tint, 2 * tint))
        k = n * (torch.expm1(above) * -torch.expm1(-below)).sqrt()
        return Metal(n, k, self.roughness.value(x[self.size - 1]))

    def free(self, material: Metal) -> Float[Tensor, " x"]:
        roughness = self.roughness.free(self.roughness.inside(material.roughness))[None]
        parts = [_reflectivity_of(material.n, material.k), tint_of(material.n, material.k), roughness]
        return torch.cat(parts if self.tint is None else parts[::2])

    def elsewhere(self, x: Float[Tensor, " x"]) -> list[Float[Tensor, " x"]]:
        """The same F0 and roughness with other n: curves of equal F0 cross, and the sum may have two valleys."""
        if self.tint is not None:
            return []
        return [torch.cat([x[:3], torch.full_like(x[3:6], tint), x[6:]]) for tint in TINTS]

    def prior(self, x: Float[Tensor, " x"]) -> Float[Tensor, " q"]:
        """Normal about n = 1 with `TINT_WIDTH`, wider than all metals.

        It moves nothing that the photographs determine; where they do not, it keeps the fit from a mirror of n = 100
        that looks the same.
        """
        return x[3:6] / TINT_WIDTH if self.tint is None else x[:0]


@dataclass(frozen=True)
class GlossyCoordinates(Coordinates[Glossy]):
    """The free vector of a glossy material: colour per channel, reflectance, roughness, each inside its interval.

    Attributes:
        roughness: the interval of roughness.
        reflectance: the interval of reflectance.
        channels: 3, or 1 where the channels share one reflectance, as a dielectric's nearly do.
    """

    roughness: Interval
    reflectance: Interval = UNIT
    channels: int = 3

    @property
    def size(self) -> int:
        return 4 + self.channels

    def material(self, x: Float[Tensor, " x"]) -> Glossy:
        x = x.clamp(-_REACH, _REACH)
        reflectance = self.reflectance.value(x[3 : self.size - 1]).expand(3)
        return Glossy(UNIT.value(x[:3]), reflectance, self.roughness.value(x[self.size - 1]))

    def free(self, material: Glossy) -> Float[Tensor, " x"]:
        color = UNIT.free(UNIT.inside(material.color))
        reflectance = self.reflectance.free(self.reflectance.inside(material.reflectance[: self.channels]))
        return torch.cat([color, reflectance, self.roughness.free(self.roughness.inside(material.roughness))[None]])


@dataclass(frozen=True)
class MatteCoordinates(Coordinates[Matte]):
    """The free vector of a matte material: colour per channel, and reflectance for all of them or for each.

    A reflectance above 1, which no material has, is for the fit alone: a surface that darkens towards grazing angles.
    What is reported is told by `fitter.uncertainty.active_bound`.

    Attributes:
        channels: 1 or 3, of the reflectance.
        lambert: the free number of reflectance 1, which is a Lambertian's.
    """

    channels: int = 3
    roughness = None
    lambert: ClassVar[float] = float(MATTE_REFLECTANCE.free(torch.tensor(1.0, dtype=torch.float64)))

    @property
    def size(self) -> int:
        return 3 + self.channels

    def material(self, x: Float[Tensor, " x"]) -> Matte:
        x = x.clamp(-_REACH, _REACH)
        return Matte(UNIT.value(x[:3]), MATTE_REFLECTANCE.value(x[3 : self.size]).expand(3))

    def free(self, material: Matte) -> Float[Tensor, " x"]:
        color, reflectance = UNIT.inside(material.color), MATTE_REFLECTANCE.inside(material.reflectance)
        return torch.cat([UNIT.free(color), MATTE_REFLECTANCE.free(reflectance[: self.channels])])

    def beyond_lambert(self, x: Float[Tensor, " x"]) -> Bool[Tensor, " m"]:
        """Which of a material's own numbers are reflectances above 1."""
        return torch.cat([x.new_zeros(3, dtype=torch.bool), x[3 : self.size] > self.lambert])


def tint_of(n: Float[Tensor, "3"], k: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """artanh(log n / log m): where n lies between its limits 1/m and m for the reflectivity of (n, k).

        artanh(log n / log m) = ½ log[log(nm) / log(m/n)],   log(m/n) = log(1 + k²/(n(n - 1/m)))

    and alike log(nm) where n < 1: what is left of a limit is told by k, which the difference of the logarithms would
    lose. Within ±`_REACH`, which stand for k = 0; 0 for the air's own n = 1, k = 0.
    """
    limit = fresnel.index_limit(fresnel.normal_reflectance(n, k))
    upper = torch.where(n >= 1, n, 1 / n)  # by n and 1/n the same, with the signs exchanged
    extinct = (k / n.clamp_max(1)) ** 2
    near = torch.log1p(extinct / (upper * (upper - 1 / limit)))
    tint = 0.5 * ((limit.log() + upper.log()) / near).log().clamp(0, 2 * _REACH)
    return torch.where(n >= 1, tint, -tint).nan_to_num(0.0)


def _reflectivity_of(n: Float[Tensor, "3"], k: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """logit F0 = log[((n-1)² + k²)/4n], in which 1 - F0 is not lost where F0 → 1."""
    return (((n - 1) ** 2 + k**2) / (4 * n)).log().clamp(-_REACH, _REACH)
