"""One vector of weighted differences between model and photographs."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fitter.parameters import Coordinates
from fitter.pixel_model import PixelModel

ROBUST_AT = 5.0  # scatters: a path tracer's noise is skewed, and a nearer threshold would favour its low side
MAD_TO_SIGMA = 1.4826  # of a normal distribution: 1/Φ⁻¹(¾)


@dataclass(frozen=True)
class Residuals:
    """Weighted, robust differences as a function of the free vector.

    Attributes:
        model: the picture as a function of the material.
        coordinates: the material as a function of the free vector.
        photograph: radiance that was seen.
        weight: one over the radiance expected at each value.
        scatter: standard deviation of the weighted differences, as far as it is known.
    """

    model: PixelModel
    coordinates: Coordinates
    photograph: Float[Tensor, "p 3"]
    weight: Float[Tensor, "p 3"]
    scatter: float

    def weighted(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3"]:
        """(model - photograph) · weight."""
        return (self.model.radiance(self.coordinates.material(x)) - self.photograph) * self.weight

    def __call__(self, x: Float[Tensor, " x"]) -> Float[Tensor, " r"]:
        """The vector whose sum of squares is minimised: differences of the pictures, and the coordinates' prior."""
        differences = pseudo_huber(self.weighted(x), ROBUST_AT * self.scatter).flatten()
        return torch.cat([differences, self.coordinates.prior(x) * self.scatter])


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
