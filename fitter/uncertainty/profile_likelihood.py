"""Profile-likelihood intervals by damped sequential quadratic programming.

The interval of a quantity q ends where q is extreme among all free vectors that fit nearly as well as the one reported,

    extremes of q(x') over D(x') ≤ κ χ²,   D(x') = |R(x') - δ|² - |R(x) - δ|²,   χ² = 1.96²

which are where q's profile crosses that level [Venzon & Moolgavkar 1988, eq. 3]. R are residuals; δ, the part of them
that would move x, is subtracted because x is freed of bias and so not quite R's own minimum. κ, the sandwich's variance
of q over that of the inverse information, is how far the noise is from what the weights assume [Royall & Tsou 2003].

Each end is a constrained extremum of its own; all are sought at once. Only where the ellipsoid of the covariance fails,
because the residuals are curved, is anything sought.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.fitter.least_squares.covariance import TWO_SIDED_95, Covariance, intervals95, standard_errors
from fit_material.fitter.least_squares.jacobian import Function, jacobian, jacobians
from fit_material.fitter.uncertainty.deviance import Deviance, dispersion_of

if TYPE_CHECKING:
    from fit_material.fitter.estimation.coarse_to_fine import Fit

Extent = tuple[Float[Tensor, " q"], Float[Tensor, " q"]]

ELLIPSE_HOLDS = 0.2, 0.1  # how far its ends may be from the deviance wanted, and from the place after one more step
CLOSE = 0.04, 0.02  # the same of an end that is searched for: 2 % of its distance
MOST_STEPS = 30
LONGEST = 1.0  # of a step in any free number: sigmoids and tints bend within it
FARTHEST = 3.0  # of a start in any free number
DAMPING, LEAST_DAMPING = 1.0, 1e-9  # deviance per squared free number
SOFTER, HARDER = 0.2, 5.0  # factors on the damping after a step that helped, and after one that did not
OVERSHOT = 2.0  # price of deviance beyond the bound over what it gains in the quantity: more than 1, or it would grow
UNRELATED = 1e4  # κ, from which weights and scatter have nothing to do with each other


def intervals(fit: Fit, spread: Covariance, quantity: Function) -> Extent:
    """Ends of the 95 % interval of each of `quantity(x)`; by the ellipsoid alone where the fit cannot be condensed."""
    if fit.condensate is None:
        return intervals95(quantity, fit.x, spread)
    return profiled(fit.condensate, fit.x, spread, quantity)


def profiled(residual: Function, x: Float[Tensor, " x"], spread: Covariance, quantity: Function) -> Extent:
    """Ends of the 95 % interval of each of `quantity(x)`: the ellipsoid's where it holds, else the profile's.

    Args:
        residual: least squares, cheap, and such that `torch.vmap` takes it.
        x: the free vector reported, near the residuals' minimum.
        spread: its covariance.
        quantity: a smooth function of the free vector.

    Returns:
        lower and upper ends: in order, around the value, finite where the ellipsoid's are.
    """
    ellipse = torch.stack(intervals95(quantity, x, spread))
    folded, along, way = _folds(quantity, x, spread)
    slope = torch.where(folded[:, None], torch.eye(len(x), dtype=x.dtype)[along], jacobian(quantity, x))
    constraint = Deviance.around(residual, quantity, x, dispersion_of(residual, x, slope, spread))
    ends = IntervalEnds.of((constraint.dispersion < UNRELATED) & ellipse.isfinite().all(0))
    ends = ends.only(folded[ends.index] | ~_ellipse_converged(constraint, ends))
    refolded = ends.only(folded[ends.index])
    aside = [x + side * way[refolded.index] for side in (-1, 1)]
    starts = torch.cat([x.expand(len(ends.index), -1), *aside])
    if not len(starts):
        return ellipse[0], ellipse[1]
    every = IntervalEnds.concatenate([ends, refolded, refolded])
    return _combined(ellipse, *_searched(_Iterates.at(constraint, every, starts)))


def _ellipse_converged(constraint: Deviance, ends: IntervalEnds) -> Bool[Tensor, " e"]:
    """Whether one step to the ends of linear residuals leads to the ends."""
    if not len(ends.index):
        return torch.zeros(0, dtype=torch.bool)
    iterates = _Iterates.at(constraint, ends, constraint.x.expand(len(ends.index), -1))
    step, _ = iterates.step(LEAST_DAMPING, longest=torch.inf)
    return _Iterates.at(constraint, ends, iterates.x + step).converged(*ELLIPSE_HOLDS)


@dataclass(frozen=True)
class IntervalEnds:
    """Ends of intervals.

    Attributes:
        index: of the quantity.
        side: of its value, -1 or 1.
    """

    index: Int[Tensor, " e"]
    side: Float[Tensor, " e"]

    @staticmethod
    def of(known: Bool[Tensor, " q"]) -> IntervalEnds:
        """Both ends of these."""
        index = known.nonzero()[:, 0]
        sides = torch.ones(len(index), dtype=torch.float64)
        return IntervalEnds(torch.cat([index, index]), torch.cat([-sides, sides]))

    def only(self, which: Bool[Tensor, " e"]) -> IntervalEnds:
        return IntervalEnds(self.index[which], self.side[which])

    @staticmethod
    def concatenate(parts: Sequence[IntervalEnds]) -> IntervalEnds:
        return IntervalEnds(torch.cat([each.index for each in parts]), torch.cat([each.side for each in parts]))


@dataclass(frozen=True)
class _Iterates:
    """Iterates of the search for each end.

    Attributes:
        constraint: deviance, and its bound.
        ends: that are sought.
        x: the free vectors.
        deviance, gradient, information: as `Deviance.deviance` has it.
        distance, slope: of the quantity from its value, outwards, and the gradient of that.
    """

    constraint: Deviance
    ends: IntervalEnds
    x: Float[Tensor, "e x"]
    deviance: Float[Tensor, " e"]
    gradient: Float[Tensor, "e x"]
    information: Float[Tensor, "e x x"]
    distance: Float[Tensor, " e"]
    slope: Float[Tensor, "e x"]

    @staticmethod
    def at(constraint: Deviance, ends: IntervalEnds, x: Float[Tensor, "e x"]) -> _Iterates:
        values, slopes = jacobians(constraint.quantity, x)
        each = torch.arange(len(x))
        distance = ends.side * (values - constraint.quantity(constraint.x))[each, ends.index]
        slope = ends.side[:, None] * slopes[each, ends.index]
        return _Iterates(constraint, ends, x, *constraint.deviance(x), distance, slope)

    @property
    def wanted(self) -> Float[Tensor, " e"]:
        return self.constraint.wanted[self.ends.index]

    def step(self, damping: Float[Tensor, " e"] | float, longest: float = LONGEST) -> tuple[Tensor, Tensor]:
        """Solution of the linearised problem, and the Lagrange multiplier of its constraint D = κ χ².

            d = -H⁻¹g + ρ H⁻¹a,   H = JᵀJ + damping,   ρ² = (κ χ² - D + gᵀH⁻¹g)/aᵀH⁻¹a

        Its fixed points are the ends, whatever the damping. The multiplier, 2ρ, is the deviance per unit of q there.
        """
        damped = self.information + torch.as_tensor(damping).reshape(-1, 1, 1) * torch.eye(self.x.shape[1]).double()
        solved = torch.linalg.solve_ex(damped, torch.stack([-self.gradient, self.slope], -1)).result
        down, outwards = solved.unbind(-1)
        left = (self.wanted - self.deviance - (self.gradient * down).sum(-1)).clamp_min(0)
        rho = (left / (self.slope * outwards).sum(-1).clamp_min(torch.finfo(left.dtype).tiny)).sqrt()
        step = down + rho[:, None] * outwards
        return step * (longest / step.abs().amax(-1)).clamp_max(1)[:, None], 2 * rho

    def feasible(self) -> Bool[Tensor, " e"]:
        """Which iterates satisfy the constraint, up to `CLOSE`."""
        return self.deviance <= (1 + CLOSE[0]) * self.wanted

    def converged(self, of_deviance: float, of_distance: float) -> Bool[Tensor, " e"]:
        """Which iterates are at their ends: feasible, and another step would not take them further."""
        ahead = (self.slope * self.step(LEAST_DAMPING)[0]).sum(-1)
        return (self.deviance <= (1 + of_deviance) * self.wanted) & (ahead.abs() <= of_distance * self.distance)

    def merit(self, price: Float[Tensor, " e"]) -> Float[Tensor, " e"]:
        """Merit function: the distance, less an exact penalty on deviance beyond the bound."""
        return price * self.distance - OVERSHOT * (self.deviance - self.wanted).clamp_min(0)

    def blended(self, other: _Iterates, where: Bool[Tensor, " e"]) -> _Iterates:
        """These iterates, replaced by `other` where chosen."""

        def either(mine: Tensor, its: Tensor) -> Tensor:
            return torch.where(where.reshape(-1, *[1] * (mine.dim() - 1)), its, mine)

        names = ("x", "deviance", "gradient", "information", "distance", "slope")
        return replace(self, **{name: either(getattr(self, name), getattr(other, name)) for name in names})


def _searched(iterates: _Iterates) -> tuple[_Iterates, Bool[Tensor, " e"]]:
    """The farthest feasible iterates, and which of them are at their ends."""
    damping, farthest = torch.full_like(iterates.distance, DAMPING), iterates
    for _ in range(MOST_STEPS):
        farther = (iterates.distance > farthest.distance) | ~farthest.feasible()
        farthest = farthest.blended(iterates, iterates.feasible() & farther)
        converged = iterates.converged(*CLOSE)
        if converged.all():
            break
        step, price = iterates.step(damping)
        after = _Iterates.at(iterates.constraint, iterates.ends, iterates.x + step)
        better = after.merit(price) > iterates.merit(price)
        iterates, damping = iterates.blended(after, better), damping * torch.where(better, SOFTER, HARDER)
    return farthest, converged


def _folds(
    quantity: Function, x: Float[Tensor, " x"], spread: Covariance
) -> tuple[Bool[Tensor, " q"], Int[Tensor, " q"], Float[Tensor, "q x"]]:
    """Quantities that have an extremum within the ellipsoid, as k has where n = 1, so that two ways lead to one end.

    Their slope at x is no guide.

    Returns:
        which they are; along which free number they fold, and the way to the ellipsoid's end in that number.
    """
    sigma = spread.covariance.diagonal().clamp_min(torch.finfo(x.dtype).tiny).sqrt()
    ways = TWO_SIDED_95 * spread.covariance / sigma[:, None]
    ways = ways * (FARTHEST / ways.abs().amax(1)).clamp_max(1)[:, None]
    back, on = (torch.vmap(quantity)(x + side * ways) for side in (-1, 1))
    even, odd = ((on + back) / 2 - quantity(x)).abs(), (on - back).abs() / 2
    even = torch.where(even > odd / 2, even, 0.0)  # of a parabola: its peak is between the ends
    along = even.argmax(0)
    half_width = TWO_SIDED_95 * standard_errors(quantity, x, spread)
    return even.amax(0) > ELLIPSE_HOLDS[1] * half_width, along, ways[along]


def _combined(ellipse: Float[Tensor, "2 q"], farthest: _Iterates, converged: Bool[Tensor, " e"]) -> Extent:
    """Ends that were searched for, the ellipsoid's of the others; the wider of both where a search did not converge.

    A feasible iterate on the way to one end counts for all others.
    """
    constraint, index, side = farthest.constraint, farthest.ends.index, farthest.ends.side
    values, value = torch.vmap(constraint.quantity)(farthest.x), constraint.quantity(constraint.x)
    inside = (farthest.deviance[:, None] <= (1 + CLOSE[0]) * constraint.wanted) & values.isfinite()
    low = torch.where(inside, values, torch.inf).amin(0).minimum(value)
    high = torch.where(inside, values, -torch.inf).amax(0).maximum(value)
    sought, ended = torch.zeros_like(ellipse, dtype=torch.bool), torch.zeros_like(ellipse, dtype=torch.bool)
    sides = (side > 0).long()
    sought[sides, index] = True
    ended[sides[converged], index[converged]] = True
    widest = torch.stack([low.minimum(ellipse[0]), high.maximum(ellipse[1])])
    ends = torch.where(sought, torch.where(ended, torch.stack([low, high]), widest), ellipse)
    return ends[0], ends[1]
