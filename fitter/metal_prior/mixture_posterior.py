"""The catalogue as a mixture of normal distributions, and its posterior under the photographs' likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.metal_prior.borrowed import Borrowed, TooFar, Triple
from fit_material.fitter.metal_prior.catalogue_distribution import Expected, Shape, expectations
from fit_material.fitter.metal_prior.likelihood import Likelihood, indices
from fit_material.fitter.uncertainty.estimates import Measured
from fit_material.renderer.materials.catalogue import Metal, read_catalogue

UNKNOWN_SHARE = 0.05  # of metals outside the catalogue, before any photograph
TOO_FAR = 0.0027  # chance of a metal's own photographs to lie as far from it: three standard deviations
DRAWS = 2000  # of each metal's posterior: its quantiles to 1 % of a standard deviation
DEGREES_OF_FREEDOM = 4  # of the t distribution they are drawn from: heavier tails than those of the posterior
LEAST_SHARE = 0.05  # of a metal worth naming


def catalogue_prior(
    seen: Likelihood, metals: Sequence[Metal] | None = None, unknown_share: float = UNKNOWN_SHARE
) -> Borrowed | TooFar:
    """Posterior n and k: each known metal by how well the photographs fit it, and a share for metals not known.

    A metal is a normal distribution about its catalogued F0 and tint, as wide as two published measurements of one
    metal differ. Metals not known are as the catalogue's, twice as wide. Each metal's posterior under the photographs'
    likelihood is drawn from by importance sampling about its maximum.

    Args:
        seen: the photographs' own word.
        metals: known ones; the catalogue's where left out.
        unknown_share: prior probability of none of them, in [0, 1).

    Returns:
        n and k, their value that of the mean tint at the fitted F0; or the nearest metal, where none is near enough or
        a metal that is not known is more likely than all that are.
    """
    from scipy.stats import chi2

    metals = read_catalogue() if metals is None else metals
    parts = [_posterior(known, seen) for known in expectations(metals)]
    shares = torch.tensor([(1 - unknown_share) / len(metals)] * len(metals) + [unknown_share], dtype=torch.float64)
    away = torch.tensor([part.away for part in parts], dtype=torch.float64)
    near = away <= float(chi2.isf(TOO_FAR, seen.freedom))
    near[-1] = True
    evidence = shares.log() + torch.stack([part.log_evidence for part in parts])
    shares = torch.softmax(evidence.where(near, -torch.inf), 0)
    if not near[:-1].any() or shares[-1] > 0.5:
        nearest = int(away[:-1].argmin())
        return TooFar(metals[nearest].title, math.sqrt(away[nearest] / seen.freedom))
    order = shares[:-1].argsort(descending=True).tolist()
    named = [(metals[i].title, float(shares[i])) for i in order if shares[i] >= LEAST_SHARE or i == order[0]]
    draws = torch.cat([part.draws for part in parts])
    weights = torch.cat([share * part.weights for share, part in zip(shares, parts, strict=True)])
    return Borrowed(tuple(named), *_posterior_indices(draws, weights, seen.f0))


@dataclass(frozen=True)
class _Posterior:
    """Of the shape, if it is one metal's.

    Attributes:
        away: least sum of squared deviations from the metal and from the photographs, χ² of as many degrees of
            freedom as reflectances are seen.
        log_evidence: logarithm of the photographs' probability, but for a constant.
        draws, weights: a weighted sample; its weights sum to 1.
    """

    away: float
    log_evidence: Float[Tensor, ""]
    draws: Float[Tensor, "d 6"]
    weights: Float[Tensor, " d"]


def _posterior(expected: Expected, seen: Likelihood) -> _Posterior:
    from scipy.optimize import least_squares
    from scipy.stats import multivariate_t

    def deviations(shape: Shape) -> Tensor:
        return torch.cat([seen(shape), expected(shape)], -1)

    def slope(shape: Shape) -> Tensor:
        return torch.cat([seen.slope(shape), expected.slope])

    start = torch.cat([torch.logit(seen.f0), expected.mean[3:]])

    def of_numpy(function: Callable[[Tensor], Tensor]) -> Callable[[np.ndarray], np.ndarray]:
        return lambda shape: function(torch.from_numpy(shape)).numpy()

    best = least_squares(of_numpy(deviations), start.numpy(), jac=of_numpy(slope))  # type: ignore[arg-type]
    gauss_newton = slope(torch.from_numpy(best.x))
    covariance = torch.linalg.inv(gauss_newton.T @ gauss_newton)
    proposal = multivariate_t(best.x, (covariance + covariance.T).numpy() / 2, DEGREES_OF_FREEDOM, seed=0)
    sample = proposal.rvs(DRAWS)
    draws = torch.from_numpy(sample)
    log_weights = -0.5 * deviations(draws).square().sum(-1) - torch.from_numpy(proposal.logpdf(sample))
    log_evidence = expected.log_density + torch.logsumexp(log_weights, 0) - math.log(DRAWS)
    return _Posterior(max(0.0, 2 * best.cost - seen.least), log_evidence, draws, torch.softmax(log_weights, 0))


def _posterior_indices(
    draws: Float[Tensor, "d 6"], weights: Float[Tensor, " d"], f0: Float[Tensor, "3"]
) -> tuple[Triple, Triple]:
    """n and k, with errors and intervals, of a weighted sample."""
    tint = weights @ draws[:, 3:]
    values = indices(torch.cat([torch.logit(f0), tint]))
    sampled = indices(draws)

    def measured(which: int, channel: int) -> Measured:
        return _measured(float(values[which][channel]), sampled[which][:, channel], weights)

    n, k = ((measured(which, 0), measured(which, 1), measured(which, 2)) for which in (0, 1))
    return n, k


def _measured(value: float, sample: Float[Tensor, " d"], weights: Float[Tensor, " d"]) -> Measured:
    """The value, with the standard deviation of the weighted sample and its central 95 %."""
    mean = weights @ sample
    error = float((weights @ (sample - mean) ** 2).sqrt())
    order = sample.argsort()
    below = weights[order].cumsum(0).contiguous()
    at = torch.searchsorted(below, torch.tensor([0.025, 0.975], dtype=below.dtype)).clamp_max(len(sample) - 1)
    low, high = sample[order][at].tolist()
    return Measured(value, error, (min(low, value), max(high, value)))
