"""How far the photographs determine each number: from Jacobian and scatter to standard errors and verdicts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

Function = Callable[[Tensor], Tensor]

TWO_SIDED_95 = 1.959964  # Φ⁻¹(0.975)

# A number counts as determined while the half width of its 95 % interval stays below this share of the value, or
# below this absolute width: beyond it the interval no longer tells one metal from its neighbours.
DETERMINED_RELATIVE = {"n": 0.25, "k": 0.25, "f0": 0.05, "alpha": 0.25, "roughness": 0.25}
DETERMINED_ABSOLUTE = {"n": 0.02, "k": 0.1, "f0": 0.02, "alpha": 0.005, "roughness": 0.02}


@dataclass(frozen=True)
class Spread:
    """Covariance of a free vector.

    Attributes:
        covariance: float64 [x, x]; infinite variances are represented by very large ones.
        rank: number of directions that the residuals determine to working precision.
    """

    covariance: Float[Tensor, "x x"]
    rank: int


def spread(residual: Function, halves: tuple[Function, Function], x: Float[Tensor, " x"]) -> Spread:
    """Covariance at a minimum, from the residuals' own scatter and from the integration's error.

        C = (JᵀJ)⁻¹ |r|²/(m - p) + δδᵀ,   δ = ½ (JᵀJ)⁻¹Jᵀ (r_A - r_B)

    r_A and r_B are the residuals with either half of the light table's samples: δ is how far the parameters moved
    if the other half were believed. (JᵀJ)⁻¹ comes from the singular values of J, whose smallest are cut off at
    working precision, so that an undetermined direction has a huge but finite variance.

    Args:
        residual: r, of the whole table.
        halves: r_A and r_B.
        x: the minimum.
    """
    jacobian = torch.func.jacfwd(residual)(x)
    r = residual(x)
    _, singular, directions = torch.linalg.svd(jacobian, full_matrices=False)
    resolution = singular.max() * max(jacobian.shape) * torch.finfo(singular.dtype).eps
    inverse = directions.T / singular.clamp_min(resolution.clamp_min(torch.finfo(singular.dtype).tiny))
    variance = (r**2).sum() / max(1, len(r) - len(x))
    shift = 0.5 * inverse @ (inverse.T @ (jacobian.T @ (halves[0](x) - halves[1](x))))
    covariance = inverse @ inverse.T * variance + torch.outer(shift, shift)
    return Spread(covariance, int((singular > resolution).sum()))


def standard_errors(quantity: Function, x: Float[Tensor, " x"], spread: Spread) -> Float[Tensor, " q"]:
    """Standard errors of `quantity(x)` to first order: √diag(G C Gᵀ), G its Jacobian."""
    gradient = torch.func.jacfwd(quantity)(x)
    return (gradient @ spread.covariance * gradient).sum(-1).clamp_min(0).sqrt()


def interval95(value: float, stderr: float, low: float, high: float) -> tuple[float, float]:
    """The 95 % interval, cut off at the ends of the quantity's domain."""
    half = TWO_SIDED_95 * stderr
    return max(low, value - half), min(high, value + half)


def is_determined(parameter: str, value: float, stderr: float) -> bool:
    """Whether the 95 % interval is narrow enough to mean something; see `DETERMINED_RELATIVE`."""
    widest = max(DETERMINED_RELATIVE[parameter] * abs(value), DETERMINED_ABSOLUTE[parameter])
    return TWO_SIDED_95 * stderr <= widest
