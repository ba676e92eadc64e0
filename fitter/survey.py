"""A look at all roughnesses, where near the one found none looks different."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitter.alike import Alike, as_good
from fitter.halves import Halves
from fitter.search import Fit, Problem, facing, is_roughness_resolved, next_round, refined, roughness_of
from renderer.transport import LightTable

NARROW = 1e-3  # half the relative width of a table of one roughness


def surveyed(problem: Problem, fit: Fit) -> Fit:
    """The fit with what else its roughness may be; begun anew where another one explains the photographs better.

    That is asked only where the picture does not change with the roughness: else its error is known. Where a second fit
    is no better, it is stopped.
    """
    for left in (1, 0):
        if is_roughness_resolved(fit):
            return fit
        survey = _Survey.of(facing(problem, fit), fit)
        if survey.as_good[survey.nearest] or not left:
            break
        fit = refined(problem, survey.fits[survey.best])
    stopped = replace(fit.solution, status="stopped")
    found = fit if survey.as_good[survey.nearest] else replace(fit, solution=stopped)
    return replace(found, alike=survey.alike)


@dataclass(frozen=True)
class _Survey:
    """Fits with the roughness held at each of the levels of the search's table.

    Attributes:
        fits: from the lowest to the highest.
        roughness: theirs.
        nearest, best: which of them has the roughness found, and which explains the photographs best.
        as_good: which explain them as well.
    """

    fits: Sequence[Fit]
    roughness: Float[Tensor, " a"]
    nearest: int
    best: int
    as_good: Bool[Tensor, " a"]

    @staticmethod
    def of(problem: Problem, fit: Fit) -> _Survey:
        table = problem.coarse.search_table
        fits = [next_round(problem.coarse, fit, level) for level in _levels(table)]
        roughness = torch.tensor(table.roughnesses, dtype=torch.float64)
        nearest = int((roughness / roughness_of(fit)).log().abs().argmin())
        squares = _squares(fits, nearest)
        best = int(squares.sum(1).argmin())
        return _Survey(fits, roughness, nearest, best, as_good(squares))

    @property
    def alike(self) -> Alike:
        """The span of roughnesses that are as good, to the next that are not; and what the rest does in it."""
        inside = self.as_good.clone()
        inside[self.nearest] = True
        known = inside.nonzero()[:, 0].tolist()
        low, high = max(known[0] - 1, 0), min(known[-1] + 1, len(self.fits) - 1)
        x = torch.stack([self.fits[each].x for each in known])
        moved = x - self.fits[self.nearest].x
        moved[:, self.fits[0].residuals.coordinates.size - 1] = 0.0
        return Alike((float(self.roughness[low]), float(self.roughness[high])), moved)


def _squares(fits: Sequence[Fit], nearest: int) -> Float[Tensor, "a p"]:
    """r_A · r_B of each fit and pixel, weighed as by the nearest: the table's noise is no misfit."""
    whitening = fits[nearest].residuals.robust_whitening(fits[nearest].x)
    halves = [Halves.at(fit.x, fit.residuals, whitening).differences for fit in fits]
    return torch.stack([(first * second).sum(1) for first, second in halves])


def _levels(table: LightTable) -> Iterator[LightTable]:
    """Each of the table's levels as a table of its own."""
    for index, roughness in enumerate(table.roughnesses):
        light = table.light[:, index : index + 1]
        yield replace(table, light=light, low=roughness * (1 - NARROW), high=roughness * (1 + NARROW))
