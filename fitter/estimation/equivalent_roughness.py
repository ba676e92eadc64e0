"""Which roughnesses explain photographs as well as the one found, where near that one none looks different."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.least_squares.covariance import TWO_SIDED_95


@dataclass(frozen=True)
class Alike:
    """What a fit may as well be, where the picture does not change with its roughness.

    Attributes:
        span: of the roughnesses.
        moved: by how much the rest of the free vector differs there, for some of them.
    """

    span: tuple[float, float]
    moved: Float[Tensor, "a x"]

    @property
    def covariance(self) -> Float[Tensor, "x x"]:
        """As if all up to the farthest were equally likely, on both sides."""
        mixed = self.moved.T @ self.moved
        scale = mixed.diagonal().sqrt().clamp_min(torch.finfo(mixed.dtype).tiny)
        farthest = self.moved.abs().amax(0) / 3**0.5 / scale
        return farthest * mixed * farthest[:, None]


def as_good(squares: Float[Tensor, "a p"]) -> Bool[Tensor, " a"]:
    """Which models explain pixels as well as the best, but for chance: 95 % of what it makes of their difference.

        Σ_i d_i ≤ 1.96 √(Σ_i (d_i - d̄)²) + 1.96²,   d_i = squares_i - squares_i of the best        [Vuong 1989, eq. 6.1]

    Args:
        squares: of each model's whitened residuals, by pixel.
    """
    worse = squares - squares[squares.sum(1).argmin()]
    by_chance = (worse - worse.mean(1, keepdim=True)).square().sum(1).sqrt()
    return worse.sum(1) <= TWO_SIDED_95 * by_chance + TWO_SIDED_95**2
