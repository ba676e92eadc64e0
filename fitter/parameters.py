"""The unknowns of a metal: between physical quantities and the free vector that a solver may move anywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import softplus

from shaders import fresnel
from shaders.materials import Metal

_REACH = 30.0  # 1 - tanh² = 1e-25: float64 holds two more digits
_MOST_REFLECTIVE = 9.2  # F0 = 0.9999, which no metal exceeds; n and k stay below 1e5 where a fit runs into it


@dataclass(frozen=True)
class Interval:
    """An open interval of roughness, on a linear or a logarithmic scale, as the image of the whole real line."""

    low: float
    high: float
    logarithmic: bool

    def value(self, free: Float[Tensor, ""]) -> Float[Tensor, ""]:
        """low + (high - low)·sigmoid(free), or the same between the logarithms."""
        share = torch.sigmoid(free)
        if self.logarithmic:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    def free(self, value: Float[Tensor, ""]) -> Float[Tensor, ""]:
        """The inverse of `value`."""
        if self.logarithmic:
            return torch.logit((value / self.low).log() / math.log(self.high / self.low))
        return torch.logit((value - self.low) / (self.high - self.low))


@dataclass(frozen=True)
class MetalCoordinates:
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

    def metal(self, x: Float[Tensor, " x"]) -> Metal:
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
        return Metal(n, k, self.roughness.value(x[-1]))

    def free(self, metal: Metal) -> Float[Tensor, " x"]:
        """The free vector of a metal whose quantities lie inside their domains."""
        parts = [torch.logit(metal.f0), tint_of(metal.n, metal.k), self.roughness.free(metal.roughness)[None]]
        return torch.cat(parts if self.tint is None else parts[::2])


def tint_of(n: Float[Tensor, "3"], k: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """artanh(log n / log m): where n lies between its limits 1/m and m for the reflectivity of (n, k)."""
    limit = fresnel.index_limit(fresnel.normal_reflectance(n, k))
    return torch.atanh(n.log() / limit.log())
