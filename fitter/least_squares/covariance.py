"""How far the photographs determine each number: from Jacobian and scatter to standard errors and verdicts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.least_squares.jacobian import Function, jacobian
from fit_material.fitter.least_squares.sample_halves import Halves, inverse_of

if TYPE_CHECKING:
    from fit_material.fitter.least_squares.residuals import Residuals

TWO_SIDED_95 = 1.959964  # Φ⁻¹(0.975)

MOST_BIAS = 3.0  # standard errors that a step may take: of few pixels, halves know too little to be followed further
UNBIASED_STEPS, UNBIASED_WITHIN = 32, 0.01  # at most so many, until one is that part of a standard error
DAMPED = 0.1  # share of the information by which a step that led upwards is shortened first, and each time tenfold


@dataclass(frozen=True)
class Covariance:
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
    nothing of the other half's noise, as instruments in regression [Reiersøl 1945]. What they set to zero is the slope
    of ½ r_A · r_B, so that steps along a bent valley can be damped until that falls [Levenberg 1944].

    Args:
        residuals: of the whole table, whose halves are independent.
        x: their minimum.
    """
    if residuals.model.table is None:
        return x
    whitening = residuals.robust_whitening(x)
    here, damping = Halves.at(x, residuals, whitening), 0.0
    for _ in range(UNBIASED_STEPS):
        information, slope = here.information, here.slope_of_crossed
        whole_way = inverse_of(information) @ slope
        if not (whole_way @ information @ whole_way).clamp_min(0).sqrt() > UNBIASED_WITHIN:
            return x - whole_way
        way = inverse_of(information + damping * torch.diag(information.diagonal())) @ slope
        way = way / ((way @ information @ way).clamp_min(0).sqrt() / MOST_BIAS).clamp_min(1)
        there = Halves.at(x - way, residuals, whitening)
        if there.crossed < here.crossed:
            x, here, damping = x - way, there, damping / 10
        else:
            damping = max(DAMPED, 10 * damping)
    return x


def sandwich_covariance(residuals: Residuals, x: Float[Tensor, " x"]) -> Covariance:
    """Covariance at a solution of `unbiased`, from the residuals' own scatter.

        C = H⁻¹ (m/(m - p) Σ_i gᵢgᵢᵀ + P) H⁻¹        [White 1982, eq. 3.2]
        H = ½ Σ_i (J_AᵀJ_B + J_BᵀJ_A)ᵢ + P,   gᵢ = ½ (J_Aᵀ r_B + J_Bᵀ r_A)ᵢ

    i counts the m pixels, whose channels share their noise; P is the prior's part of H. Nothing is taken for granted
    but that pixels are independent: the noise may differ between them, and need not be what the weights assume. The
    integration's error is independent between pixels, too, and so is within their scatter. Where pixels are known to
    err together, i counts clusters of them, and g is their sum [Liang & Zeger 1986].

    A direction in which nothing is known, because the picture changes along it by no more than its own error, has a
    huge but finite variance.

    Args:
        residuals: of the whole table.
        x: the solution.
    """
    halves = Halves.at(x, residuals, residuals.robust_whitening(x))
    scores = halves.scores
    if residuals.clusters is not None:
        sums = scores.new_zeros(int(residuals.clusters.max()) + 1, scores.shape[1])
        scores = sums.index_add(0, residuals.clusters, scores)
    freedom = len(scores) / max(1, len(scores) - len(x))
    inverse = inverse_of(halves.information)
    scattered = scores.T @ scores * freedom + halves.of_prior.T @ halves.of_prior
    return Covariance(inverse @ scattered @ inverse + halves.unknown)


def integration_share(residuals: Residuals, x: Float[Tensor, " x"]) -> float:
    """Share of the variance of a solution that the integration of light brought, in [0, 1].

    Half the difference of the table's halves has the variance of their mean's error, and knows of nothing else.
    """
    if residuals.model.table is None:
        return 0.0
    halves = Halves.at(x, residuals, residuals.robust_whitening(x))
    (first, second), inverse = halves.differences, inverse_of(halves.information)
    scores = (torch.einsum("prx,pr->px", halves.slope, each) for each in ((first - second) / 2, (first + second) / 2))
    own, all_ = (float(((each @ inverse) * each).sum()) for each in scores)
    return min(1.0, own / all_) if all_ > 0 else 1.0


def standard_errors(quantity: Function, x: Float[Tensor, " x"], spread: Covariance) -> Float[Tensor, " q"]:
    """Standard errors of `quantity(x)` to first order: √diag(G C Gᵀ), G its Jacobian."""
    gradient = jacobian(quantity, x)
    return (gradient @ spread.covariance * gradient).sum(-1).clamp_min(0).sqrt()


def intervals95(
    quantity: Function, x: Float[Tensor, " x"], spread: Covariance
) -> tuple[Float[Tensor, " q"], Float[Tensor, " q"]]:
    """Ends of the 95 % interval of each of `quantity(x)`.

    The quantity is followed to where it is extreme on the ellipsoid of the free vector, x ± 1.96 C g / √(gᵀC g)
    with g its gradient: unlike value ± 1.96 errors, such an interval is as lopsided as the quantity itself and never
    leaves its domain.
    """
    gradient = jacobian(quantity, x)
    reach = gradient @ spread.covariance
    error = (reach * gradient).sum(-1).clamp_min(torch.finfo(x.dtype).tiny).sqrt()
    way = TWO_SIDED_95 * reach / error[:, None]
    along = [torch.stack([quantity(x + sign * step)[i] for i, step in enumerate(way)]) for sign in (-1, 1)]
    ends = torch.stack([quantity(x), *along])
    return ends.amin(0), ends.amax(0)


def is_determined(resolved: tuple[float, float], value: float, interval: tuple[float, float]) -> bool:
    """Whether the 95 % interval is narrow enough to mean something.

    Args:
        resolved: relative and absolute half width, of which the wider one holds, as `Quantity.resolved`.
    """
    relative, absolute = resolved
    widest = max(relative * abs(value), absolute)
    return interval[1] - interval[0] <= 2 * widest
