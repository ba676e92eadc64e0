"""How far the photographs determine each number: from Jacobian and scatter to standard errors and verdicts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

if TYPE_CHECKING:
    from fitter.residuals import Residuals

Function = Callable[[Tensor], Tensor]

TWO_SIDED_95 = 1.959964  # Φ⁻¹(0.975)

NOTHING = 1e-100  # the precision where nothing moves the residuals at all; its inverse can still be squared
ROUNDING = 1e-14  # of the largest eigenvalue of an information matrix
MOST_BIAS = 3.0  # standard errors that a step may take: of few pixels, halves know too little to be followed further
UNBIASED_STEPS = 2  # each leaves the noise's variance, relative to the light, as a share of the error before

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


def unbiased(residuals: Residuals, x: Float[Tensor, " x"]) -> Float[Tensor, " x"]:
    """A least-squares solution, freed of the bias that noise in the light table brings.

        ½ (J_Aᵀ r_B + J_Bᵀ r_A) + ∇ prior = 0

    Least squares takes the table for exact. Its noise is in the residuals and in their slopes alike, and their product
    has a mean: the material comes out too dark by the noise's variance. The slopes of one half of the samples know
    nothing of the other half's noise, as instruments in regression [Reiersøl 1945].

    Args:
        residuals: of the whole table, whose halves are independent.
        x: their minimum.
    """
    if residuals.model.table is None:
        return x
    whitening = residuals.robust_whitening(x)
    jacobian, of_prior = torch.matmul(whitening, residuals.slope(x)), torch.func.jacfwd(residuals.prior)(x)
    information = _information(jacobian, of_prior)
    inverse = _inverse(information)
    for _ in range(UNBIASED_STEPS):
        slopes = [torch.matmul(whitening, half.slope(x)) for half in residuals.halves]
        rows = [torch.einsum("prc,pc->pr", whitening, half.difference(x)) for half in residuals.halves]
        crossed = [torch.einsum("prx,pr->x", *pair) for pair in zip(slopes, reversed(rows), strict=True)]
        step = inverse @ (sum(crossed) / 2 + of_prior.T @ residuals.prior(x))
        x = x - step / ((step @ information @ step).clamp_min(0).sqrt() / MOST_BIAS).clamp_min(1)
    return x


def spread(residuals: Residuals, x: Float[Tensor, " x"]) -> Spread:
    """Covariance at a solution, from the residuals' own scatter.

        C = H⁻¹ (m/(m - p) Σ_i gᵢgᵢᵀ + P) H⁻¹,   H = Σ_i JᵢᵀJᵢ + P,   gᵢ = Jᵢᵀrᵢ        [White 1982, eq. 3.2]

    i counts the m pixels, whose channels share their noise; P is the prior's part of H. Nothing is taken for granted
    but that pixels are independent: the noise may differ between them, and need not be what the weights say. The
    integration's error is independent between pixels, too, and so is within their scatter.

    A direction in which nothing is known has a huge but finite variance.

    Args:
        residuals: of the whole table.
        x: the solution.
    """
    whitening, of_prior = residuals.robust_whitening(x), torch.func.jacfwd(residuals.prior)(x)
    jacobian = torch.matmul(whitening, residuals.slope(x))
    scores = torch.einsum("prx,prc,pc->px", jacobian, whitening, residuals.difference(x))
    freedom = len(scores) / max(1, len(scores) - len(x))
    information = _information(jacobian, of_prior)
    inverse = _inverse(information)
    scattered = scores.T @ scores * freedom + of_prior.T @ of_prior
    return Spread(inverse @ scattered @ inverse + _unknown(information))


def _information(jacobian: Float[Tensor, "p r x"], of_prior: Float[Tensor, "q x"]) -> Float[Tensor, "x x"]:
    """JᵀJ of the pixels and of the prior."""
    rows = jacobian.flatten(0, 1)
    return rows.T @ rows + of_prior.T @ of_prior


def _inverse(information: Float[Tensor, "x x"]) -> Float[Tensor, "x x"]:
    """Its inverse; 0 in directions of which nothing is known."""
    known, directions, _ = _directions(information)
    return directions / torch.where(known > 0, known, torch.inf) @ directions.T


def _unknown(information: Float[Tensor, "x x"]) -> Float[Tensor, "x x"]:
    """The variance of what nothing is known of: that of the rounding, and no more."""
    known, directions, rounding = _directions(information)
    return directions * torch.where(known > 0, 0.0, 1 / rounding) @ directions.T


def _directions(information: Float[Tensor, "x x"]) -> tuple[Float[Tensor, " x"], Float[Tensor, "x x"], Tensor]:
    """Eigenvalues, those within rounding 0; eigenvectors; and what rounding is."""
    values, vectors = torch.linalg.eigh(information)
    rounding = (values.max() * ROUNDING).clamp_min(NOTHING)
    return torch.where(values > rounding, values, 0.0), vectors, rounding


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
