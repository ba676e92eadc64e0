"""Intervals by profile likelihood, for where the valley of a fit is curved and its ellipse lies.

A quantity q reaches to where it is extreme among all free vectors that fit nearly as well as the one reported,

    extremes of q(x') over D(x') ≤ κ χ²,   D(x') = |R(x') - δ|² - |R(x) - δ|²,   χ² = 1.96²

which are where q's profile crosses that level [Venzon & Moolgavkar 1988, eq. 3]. R are residuals; δ, the part of them
that would move x, is taken away because x is freed of bias and so not quite R's own minimum. κ, the sandwich's variance
of q over that of the inverse information, says how far the noise is from what the weights hold it for
[Royall & Tsou 2003].
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

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
OVERSHOT = 2.0  # price of deviance that is not wanted over its worth in the quantity: more than 1, or it would grow
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
    turns, along, way = _turning(quantity, x, spread)
    slope = torch.where(turns[:, None], torch.eye(len(x), dtype=x.dtype)[along], jacobian(quantity, x))
    valley = Deviance.around(residual, quantity, x, dispersion_of(residual, x, slope, spread))
    ends = _Ends.of((valley.dispersion < UNRELATED) & ellipse.isfinite().all(0))
    ends = ends.only(turns[ends.index] | ~_ellipse_holds(valley, ends))
    turned = ends.only(turns[ends.index])
    aside = [x + side * way[turned.index] for side in (-1, 1)]
    starts = torch.cat([x.expand(len(ends.index), -1), *aside])
    if not len(starts):
        return ellipse[0], ellipse[1]
    every = _Ends(*(torch.cat([part, again, again]) for part, again in zip(ends, turned, strict=True)))
    return _joined(ellipse, *_searched(_State.at(valley, every, starts)))


def _ellipse_holds(valley: Deviance, ends: _Ends) -> Bool[Tensor, " e"]:
    """Whether a step to the ends as they would be in a straight valley leads to the ends."""
    if not len(ends.index):
        return torch.zeros(0, dtype=torch.bool)
    state = _State.at(valley, ends, valley.x.expand(len(ends.index), -1))
    step, _ = state.step(LEAST_DAMPING, longest=torch.inf)
    return _State.at(valley, ends, state.x + step).holds(*ELLIPSE_HOLDS)


class _Ends(NamedTuple):
    """Which quantities' ends are sought, [e], and on which side of the value, -1 or 1."""

    index: Int[Tensor, " e"]
    side: Float[Tensor, " e"]

    @staticmethod
    def of(known: Bool[Tensor, " q"]) -> _Ends:
        """Both ends of these."""
        index = known.nonzero()[:, 0]
        sides = torch.ones(len(index), dtype=torch.float64)
        return _Ends(torch.cat([index, index]), torch.cat([-sides, sides]))

    def only(self, which: Bool[Tensor, " e"]) -> _Ends:
        return _Ends(self.index[which], self.side[which])


@dataclass(frozen=True)
class _State:
    """Free vectors on their ways to the ends, all at once.

    Attributes:
        valley: that they are in.
        ends: they seek.
        x: the free vectors.
        deviance, gradient, information: as `Deviance.deviance` has it.
        distance, slope: of the quantity from the value, outwards, and its gradient.
    """

    valley: Deviance
    ends: _Ends
    x: Float[Tensor, "e x"]
    deviance: Float[Tensor, " e"]
    gradient: Float[Tensor, "e x"]
    information: Float[Tensor, "e x x"]
    distance: Float[Tensor, " e"]
    slope: Float[Tensor, "e x"]

    @staticmethod
    def at(valley: Deviance, ends: _Ends, x: Float[Tensor, "e x"]) -> _State:
        values, slopes = jacobians(valley.quantity, x)
        each = torch.arange(len(x))
        distance = ends.side * (values - valley.quantity(valley.x))[each, ends.index]
        slope = ends.side[:, None] * slopes[each, ends.index]
        return _State(valley, ends, x, *valley.deviance(x), distance, slope)

    @property
    def wanted(self) -> Float[Tensor, " e"]:
        return self.valley.wanted[self.ends.index]

    def step(self, damping: Float[Tensor, " e"] | float, longest: float = LONGEST) -> tuple[Tensor, Tensor]:
        """To where the linearised quantity is extreme in the linearised residuals' ellipsoid D = κ χ²; and D's price.

            d = -H⁻¹g + ρ H⁻¹a,   H = JᵀJ + damping,   ρ² = (κ χ² - D + gᵀH⁻¹g)/aᵀH⁻¹a

        Its fixed points are the ends, whatever the damping. The price, 2ρ, is what deviance one more of q costs there.
        """
        damped = self.information + torch.as_tensor(damping).reshape(-1, 1, 1) * torch.eye(self.x.shape[1]).double()
        solved = torch.linalg.solve_ex(damped, torch.stack([-self.gradient, self.slope], -1)).result
        down, outwards = solved.unbind(-1)
        left = (self.wanted - self.deviance - (self.gradient * down).sum(-1)).clamp_min(0)
        rho = (left / (self.slope * outwards).sum(-1).clamp_min(torch.finfo(left.dtype).tiny)).sqrt()
        step = down + rho[:, None] * outwards
        return step * (longest / step.abs().amax(-1)).clamp_max(1)[:, None], 2 * rho

    def fits(self) -> Bool[Tensor, " e"]:
        """Which free vectors fit nearly as well as the one reported."""
        return self.deviance <= (1 + CLOSE[0]) * self.wanted

    def holds(self, of_deviance: float, of_distance: float) -> Bool[Tensor, " e"]:
        """Which are at their ends: a step would take them no further."""
        ahead = (self.slope * self.step(LEAST_DAMPING)[0]).sum(-1)
        return (self.deviance <= (1 + of_deviance) * self.wanted) & (ahead.abs() <= of_distance * self.distance)

    def worth(self, price: Float[Tensor, " e"]) -> Float[Tensor, " e"]:
        """What is to become large on the way: the distance, less what deviance beyond the one wanted costs."""
        return price * self.distance - OVERSHOT * (self.deviance - self.wanted).clamp_min(0)

    def or_else(self, other: _State, where: Bool[Tensor, " e"]) -> _State:
        """This one, but the other where told."""

        def either(mine: Tensor, its: Tensor) -> Tensor:
            return torch.where(where.reshape(-1, *[1] * (mine.dim() - 1)), its, mine)

        names = ("x", "deviance", "gradient", "information", "distance", "slope")
        return replace(self, **{name: either(getattr(self, name), getattr(other, name)) for name in names})


def _searched(state: _State) -> tuple[_State, Bool[Tensor, " e"]]:
    """The farthest states that fit, and which of them are at their ends."""
    damping, best = torch.full_like(state.distance, DAMPING), state
    for _ in range(MOST_STEPS):
        best = best.or_else(state, state.fits() & ((state.distance > best.distance) | ~best.fits()))
        found = state.holds(*CLOSE)
        if found.all():
            break
        step, price = state.step(damping)
        after = _State.at(state.valley, state.ends, state.x + step)
        better = after.worth(price) > state.worth(price)
        state, damping = state.or_else(after, better), damping * torch.where(better, SOFTER, HARDER)
    return best, found


def _turning(
    quantity: Function, x: Float[Tensor, " x"], spread: Covariance
) -> tuple[Bool[Tensor, " q"], Int[Tensor, " q"], Float[Tensor, "q x"]]:
    """Which quantities turn round within the ellipsoid, so that two ways lead to one end, as k does where n = 1.

    Their slope at x says little of them. Next to it, along which free number they turn, and the way to the ellipsoid's
    end in that number.
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


def _joined(ellipse: Float[Tensor, "2 q"], best: _State, found: Bool[Tensor, " e"]) -> Extent:
    """The ends that were searched for, the ellipsoid's of the others; the wider of both where a search did not end.

    What was met on the way to one end counts for all others.
    """
    valley, (index, side) = best.valley, best.ends
    values, value = torch.vmap(valley.quantity)(best.x), valley.quantity(valley.x)
    inside = (best.deviance[:, None] <= (1 + CLOSE[0]) * valley.wanted) & values.isfinite()
    low = torch.where(inside, values, torch.inf).amin(0).minimum(value)
    high = torch.where(inside, values, -torch.inf).amax(0).maximum(value)
    sought, ended = torch.zeros_like(ellipse, dtype=torch.bool), torch.zeros_like(ellipse, dtype=torch.bool)
    sides = (side > 0).long()
    sought[sides, index] = True
    ended[sides[found], index[found]] = True
    widest = torch.stack([low.minimum(ellipse[0]), high.maximum(ellipse[1])])
    ends = torch.where(sought, torch.where(ended, torch.stack([low, high]), widest), ellipse)
    return ends[0], ends[1]
