"""One vector of weighted differences between model and photographs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fitter.parameters import MetalCoordinates
from renderer import transport
from renderer.transport import LightTable
from shaders import fresnel
from shaders.materials import Metal

MetalReflectance = Callable[[Tensor, Tensor, Tensor], Tensor]

REFLECTANCES: dict[str, MetalReflectance] = {"conductor": fresnel.conductor, "lazanyi": fresnel.lazanyi}

ROBUST_AT = 5.0  # scatters: a path tracer's noise is skewed, and a nearer threshold would favour its low side
TINT_WIDTH = 1.5  # of artanh(log n / log m); the catalogue's metals lie within ±1
MAD_TO_SIGMA = 1.4826  # of a normal distribution: 1/Φ⁻¹(¾)


@dataclass(frozen=True)
class PixelModel:
    """The picture of a set of pixels as a function of the metal, float64.

    Attributes:
        light: the table's mean over its samples.
        table: the table itself, for its roughness weights.
        reflectance: F(cos_d, n, k).
    """

    light: Float[Tensor, "a p b 3"]
    table: LightTable
    reflectance: MetalReflectance

    @staticmethod
    def of(table: LightTable, reflectance: MetalReflectance) -> PixelModel:
        return PixelModel(table.mean(torch.float64), table, reflectance)

    def radiance(self, metal: Metal) -> Float[Tensor, "p 3"]:
        """Radiance of every pixel."""
        weights = self.table.level_weights(metal.roughness)
        degree = self.light.shape[2]
        coefficients = transport.reflectance_coefficients(
            lambda cos_d: self.reflectance(cos_d, metal.n, metal.k), degree, metal.n
        )
        return transport.radiance(self.light, weights, coefficients)


@dataclass(frozen=True)
class Residuals:
    """Weighted, robust differences as a function of the free vector.

    Attributes:
        model: the picture as a function of the metal.
        coordinates: the metal as a function of the free vector.
        photograph: radiance that was seen.
        weight: one over the radiance expected at each value.
        scatter: standard deviation of the weighted differences, as far as it is known.
    """

    model: PixelModel
    coordinates: MetalCoordinates
    photograph: Float[Tensor, "p 3"]
    weight: Float[Tensor, "p 3"]
    scatter: float

    def weighted(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3"]:
        """(model - photograph) · weight."""
        return (self.model.radiance(self.coordinates.metal(x)) - self.photograph) * self.weight

    def __call__(self, x: Float[Tensor, " x"]) -> Float[Tensor, " r"]:
        """The vector whose sum of squares is minimised: differences of the pictures, and the weak prior of the tint.

        The prior is normal about n = 1 with `TINT_WIDTH`, wider than all metals. It moves nothing that the photographs
        determine; where they do not, it keeps the fit from a mirror of n = 100 that looks the same.
        """
        differences = pseudo_huber(self.weighted(x), ROBUST_AT * self.scatter).flatten()
        if self.coordinates.tint is not None:
            return differences
        return torch.cat([differences, x[3:6] * (self.scatter / TINT_WIDTH)])


def pseudo_huber(r: Float[Tensor, "*p"], threshold: float) -> Float[Tensor, "*p"]:
    """Signed root of the pseudo-Huber loss, so that least squares of it is robust.

        ½ψ² = t²(√(1 + (r/t)²) - 1),   ψ = r √(2 / (1 + √(1 + (r/t)²)))        [Charbonnier 1997]

    Written as a product, which keeps its digits and its derivative at r = 0.
    """
    return r * (2 / (1 + (1 + (r / threshold) ** 2).sqrt())).sqrt()


def relative_weight(radiance: Float[Tensor, "p 3"], share: float = 0.05) -> Float[Tensor, "p 3"]:
    """One over the radiance, but no more than 1/`share` over its median: dark pixels hold offsets, not material."""
    floor = share * radiance.median(0).values
    return 1 / torch.maximum(radiance, floor.clamp_min(torch.finfo(radiance.dtype).tiny))


def scatter(r: Float[Tensor, "*p"]) -> float:
    """Robust standard deviation, 1.4826 times the median absolute value."""
    return MAD_TO_SIGMA * float(r.abs().median())
