"""How far the photographs determine each number: from Jacobian and scatter to standard errors and verdicts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

Function = Callable[[Tensor], Tensor]

TWO_SIDED_95 = 1.959964  # Φ⁻¹(0.975)

NOTHING = 1e-100  # the precision where nothing moves the residuals at all; its inverse can still be squared

# A number counts as determined while the half width of its 95 % interval stays below this share of the value, or
# below this absolute width: beyond it the interval no longer tells one metal from its neighbours.
DETERMINED_RELATIVE = {
    "n": 0.25,
    "k": 0.25,
    "f0": 0.05,
    "alpha": 0.25,
    "roughness": 0.25,
    "color": 0.05,
    "reflectance": 0.05,
}
DETERMINED_ABSOLUTE = {
    "n": 0.02,
    "k": 0.1,
    "f0": 0.02,
    "alpha": 0.005,
    "roughness": 0.02,
    "color": 0.02,
    "reflectance": 0.005,
}


@dataclass(frozen=True)
class Spread:
    """Covariance of a free vector.

    Attributes:
        covariance: float64 [x, x]; very large where a direction is not determined, never infinite.
    """

    covariance: Float[Tensor, "x x"]


def spread(residual: Function, halves: tuple[Function, Function], x: Float[Tensor, " x"]) -> Spread:
    """Covariance at a minimum, from the residuals' own scatter and from the integration's error.

        C = (JᵀJ)⁻¹ |r|²/(m - p) + δδᵀ + ββᵀ
        δ = ½ (s_A - s_B),   β = ½ (s_A + s_B),   s = -J⁺r

    s_A and s_B are the steps that the parameters would take if only one half of the light table's samples were
    believed. δ is their chance; β is the bias that noise in the table brings, which least squares takes for exact: a
    half has twice the noise's variance, so that it is off by twice as much.

    The pseudo-inverse cuts small singular values off at working precision: an undetermined direction has a huge but
    finite variance.

    Args:
        residual: r, of the whole table.
        halves: the same of either half.
        x: the minimum.
    """
    inverse, r = _pseudo_inverse(residual, x)
    variance = (r**2).sum() / max(1, len(r) - len(x))
    first, second = (-half_inverse @ half for half_inverse, half in (_pseudo_inverse(each, x) for each in halves))
    chance, bias = 0.5 * (first - second), 0.5 * (first + second)
    covariance = inverse @ inverse.T * variance + torch.outer(chance, chance) + torch.outer(bias, bias)
    return Spread(covariance)


def _pseudo_inverse(residual: Function, x: Float[Tensor, " x"]) -> tuple[Float[Tensor, "x r"], Float[Tensor, " r"]]:
    """J⁺ and r at x; singular values below working precision count as that precision."""
    jacobian, r = torch.func.jacfwd(residual)(x), residual(x)
    left, singular, right = torch.linalg.svd(jacobian.nan_to_num(0.0, 0.0, 0.0), full_matrices=False)
    finfo = torch.finfo(singular.dtype)
    precision = (singular.max() * max(jacobian.shape) * finfo.eps).clamp_min(NOTHING)
    return right.T / singular.clamp_min(precision) @ left.T, r


def standard_errors(quantity: Function, x: Float[Tensor, " x"], spread: Spread) -> Float[Tensor, " q"]:
    """Standard errors of `quantity(x)` to first order: √diag(G C Gᵀ), G its Jacobian."""
    gradient = torch.func.jacfwd(quantity)(x)
    return (gradient @ spread.covariance * gradient).sum(-1).clamp_min(0).sqrt()


def intervals95(
    quantity: Function, x: Float[Tensor, " x"], spread: Spread
) -> tuple[Float[Tensor, " q"], Float[Tensor, " q"]]:
    """Ends of the 95 % interval of each of `quantity(x)`.

    The quantity is followed to where it is extreme on the ellipsoid of the free vector, x ± 1.96 C g / √(gᵀC g)
    with g its gradient: unlike value ± 1.96 errors, such an interval is as lopsided as the quantity itself and never
    leaves its domain.
    """
    gradient = torch.func.jacfwd(quantity)(x)
    reach = gradient @ spread.covariance
    error = (reach * gradient).sum(-1).clamp_min(torch.finfo(x.dtype).tiny).sqrt()
    way = TWO_SIDED_95 * reach / error[:, None]
    along = [torch.stack([quantity(x + sign * step)[i] for i, step in enumerate(way)]) for sign in (-1, 1)]
    ends = torch.stack([quantity(x), *along])
    return ends.amin(0), ends.amax(0)


def is_determined(parameter: str, value: float, interval: tuple[float, float]) -> bool:
    """Whether the 95 % interval is narrow enough to mean something; see `DETERMINED_RELATIVE`."""
    widest = max(DETERMINED_RELATIVE[parameter] * abs(value), DETERMINED_ABSOLUTE[parameter])
    return interval[1] - interval[0] <= 2 * widest
