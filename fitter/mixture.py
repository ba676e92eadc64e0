"""The catalogue as a mixture of normal distributions, and its posterior under what photographs tell of a metal."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitter.catalogue import Metal, read_catalogue
from fitter.expected import Expected, Shape, expectations
from fitter.measured import Measured
from fitter.nearest import covariance_of
from fitter.parameters import TINT_WIDTH, Interval, MetalCoordinates
from fitter.uncertainty import Spread
from shaders import fresnel

UNKNOWN_SHARE = 0.05  # of metals outside the catalogue, before any photograph
TOO_FAR = 0.0027  # chance of a metal's own photographs to lie as far from it: three standard deviations
DRAWS = 2000  # of each metal's posterior: its quantiles to 1 % of a standard deviation
DEGREES_OF_FREEDOM = 4  # of the t distribution they are drawn from: heavier tails than those of the posterior
FAR = 2.0  # tints: beyond, every curve is flat
LEAST_SHARE = 0.05  # of a metal worth naming
COS_D = (0.7, 0.5, 0.34)  # 45°, 60°, 70°: the mean reflectance there follows what pictures tell of the tint


Triple = tuple[Measured, Measured, Measured]


@dataclass(frozen=True)
class TooFar:
    """The nearest known metal, and its distance in standard deviations, where none is near enough to be a prior."""

    nearest: str
    distance: float


@dataclass(frozen=True)
class Borrowed:
    """n and k as known metals suggest them.

    Attributes:
        metals: those they come from, with their shares, the greatest first.
        n, k: per channel; at the fitted F0.
        refused: why the catalogue did not serve as a prior where it was asked for.
    """

    metals: tuple[tuple[str, float], ...]
    n: Triple
    k: Triple
    refused: TooFar | None = None


def catalogue_prior(
    x: Float[Tensor, " x"],
    coordinates: MetalCoordinates,
    spread: Spread,
    metals: Sequence[Metal] | None = None,
    unknown_share: float = UNKNOWN_SHARE,
) -> Borrowed | TooFar:
    """Posterior n and k: each known metal by how well the photographs fit it, and a share for metals not known.

    A metal is a normal distribution about its catalogued F0 and tint, as wide as two published measurements of one
    metal differ. Metals not known are as the catalogue's, twice as wide. The photographs' likelihood is normal in
    reflectance, in which they are linear, at 0° and between 45° and 70°. Each metal's posterior is drawn from by
    importance sampling about its maximum.

    Args:
        x, coordinates, spread: the fit's free vector, what it stands for, and its covariance.
        metals: known ones; the catalogue's where left out.
        unknown_share: prior probability of none of them, in [0, 1).

    Returns:
        n and k, their value that of the mean tint at the fitted F0; or the nearest metal, where none is near enough or
        a metal that is not known is more likely than all that are.
    """
    from scipy.stats import chi2

    metals, seen = read_catalogue() if metals is None else metals, _seen(x, coordinates, spread)
    parts = [_posterior(known, seen) for known in expectations(metals)]
    shares = torch.tensor([(1 - unknown_share) / len(metals)] * len(metals) + [unknown_share], dtype=torch.float64)
    away = torch.tensor([part.away for part in parts], dtype=torch.float64)
    near = away <= float(chi2.isf(TOO_FAR, len(seen.found)))
    near[-1] = True
    evidence = shares.log() + torch.stack([part.log_evidence for part in parts])
    shares = torch.softmax(evidence.where(near, -torch.inf), 0)
    if not near[:-1].any() or shares[-1] > 0.5:
        nearest = int(away[:-1].argmin())
        return TooFar(metals[nearest].title, math.sqrt(away[nearest] / len(seen.found)))
    order = shares[:-1].argsort(descending=True).tolist()
    named = [(metals[i].title, float(shares[i])) for i in order if shares[i] >= LEAST_SHARE or i == order[0]]
    draws = torch.cat([part.draws for part in parts])
    weights = torch.cat([share * part.weights for share, part in zip(shares, parts, strict=True)])
    return Borrowed(tuple(named), *_posterior_indices(draws, weights, x))


@dataclass(frozen=True)
class _Seen:
    """The likelihood exp(-½ |root (y - found)|²) of reflectances y: F0, and at larger angles if they are seen."""

    found: Float[Tensor, " y"]
    root: Float[Tensor, "y y"]

    def __call__(self, shape: Shape) -> Float[Tensor, "*s y"]:
        """root (y - found)."""
        return (_reflectances(shape)[..., : len(self.found)] - self.found) @ self.root.T

    def slope(self, shape: Float[Tensor, "6"]) -> Float[Tensor, "y 6"]:
        return self.root @ _slope(shape)[: len(self.found)]


def _slope(shape: Float[Tensor, "6"], reach: Float[Tensor, " t"] | None = None) -> Float[Tensor, "6 6"]:
    """Jacobian of `_reflectances`. Each depends on its own channel alone, so that sums have all their derivatives.

    Args:
        reach: half widths of secants along the three tints, in the place of tangents: where a tint is hardly known, its
            curve is flat in places, and a tangent there would take what is not seen for known exactly.
    """
    shape = shape.detach().requires_grad_()
    halves = _reflectances(shape).reshape(2, 3).sum(1)
    rows = [torch.autograd.grad(half, shape, retain_graph=True)[0] for half in halves]
    slope = torch.cat([torch.cat([row[:3].diag(), row[3:].diag()], 1) for row in rows])
    if reach is not None and len(reach):
        way = torch.cat([torch.zeros_like(reach), reach])
        ends = [_reflectances(shape.detach() + sign * way)[3:] for sign in (-1, 1)]
        slope[3:, 3:] = ((ends[1] - ends[0]) / (2 * reach)).diag()
    return slope


def _seen(x: Float[Tensor, " x"], coordinates: MetalCoordinates, spread: Spread) -> _Seen:
    """The photographs' own word, without the wide prior on tint that the fit holds already."""
    count = 6 if coordinates.tint is None else 3
    at = torch.cat([x[:3], x[3:6] if coordinates.tint is None else coordinates.tint])

    free = x[:count]
    own = covariance_of(lambda each: each, free, Spread(spread.covariance[:count, :count]))
    precision = torch.linalg.inv(own + 1e-10 * torch.eye(count, dtype=own.dtype))
    precision[3:, 3:] -= torch.eye(count - 3, dtype=own.dtype) / TINT_WIDTH**2
    back = torch.linalg.inv(_slope(at, 1 / precision.diagonal()[3:].clamp_min(1 / FAR**2).sqrt())[:count, :count])
    power, vectors = torch.linalg.eigh(back.T @ precision @ back)
    return _Seen(_reflectances(at)[:count], power.clamp_min(0).sqrt()[:, None] * vectors.T)


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


def _posterior(expected: Expected, seen: _Seen) -> _Posterior:
    from scipy.optimize import least_squares
    from scipy.stats import multivariate_t

    def deviations(shape: Shape) -> Tensor:
        return torch.cat([seen(shape), expected(shape)], -1)

    def slope(shape: Shape) -> Tensor:
        return torch.cat([seen.slope(shape), expected.slope])

    start = torch.cat([torch.logit(seen.found[:3]), expected.mean[3:]])

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
    return _Posterior(float(2 * best.cost), log_evidence, draws, torch.softmax(log_weights, 0))


def indices(shape: Shape) -> tuple[Float[Tensor, "*s 3"], Float[Tensor, "*s 3"]]:
    """n and k."""
    coordinates = MetalCoordinates(Interval(0.0, 1.0))

    metal = coordinates.material(torch.cat([shape.movedim(-1, 0), torch.zeros_like(shape[None, ..., 0])]))
    return metal.n.movedim(0, -1), metal.k.movedim(0, -1)


def _reflectances(shape: Shape) -> Float[Tensor, "*s 6"]:
    """F0, and the mean reflectance from 45° to 70°, which grows steadily as the tint falls."""
    n, k = indices(shape)
    cos_d = torch.tensor(COS_D, dtype=torch.float64)[:, None]
    grazing = fresnel.conductor(cos_d, n[..., None, :], k[..., None, :]).mean(-2)
    return torch.cat([fresnel.normal_reflectance(n, k), grazing], -1)


def _posterior_indices(
    draws: Float[Tensor, "d 6"], weights: Float[Tensor, " d"], x: Float[Tensor, " x"]
) -> tuple[Triple, Triple]:
    """n and k, with errors and intervals, of a weighted sample."""
    tint = weights @ draws[:, 3:]
    values = indices(torch.cat([x[:3], tint]))
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
