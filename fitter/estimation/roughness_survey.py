"""A look at all roughnesses, where near the one found none looks different."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import (
    Fit,
    Problem,
    facing,
    is_roughness_resolved,
    left_its_table,
    next_round,
    refined,
    roughness_of,
)
from fit_material.fitter.estimation.equivalent_roughness import Alike, as_good
from fit_material.renderer.light_tables.light_table import LightTable

NARROW = 1e-3  # half the relative width of a table of one roughness


def surveyed(problem: Problem, fit: Fit) -> Fit:
    """The fit with what else its roughness may be; begun anew where another one explains the photographs better.

    That is computed only where the picture does not change with the roughness: else its error is known; or where the
    roughness left the last of its tables, and so was not found. Where a second fit is no better, it is stopped.
    """
    for left in (1, 0):
        if is_roughness_resolved(fit) and not left_its_table(problem, fit):
            return fit
        survey = _Survey.of(facing(problem, fit), fit)
        if survey.as_good[survey.nearest] or not left:
            break
        fit = refined(problem, survey.best)
    stopped = replace(fit.solution, status="stopped")
    found = fit if survey.as_good[survey.nearest] else replace(fit, solution=stopped)
    return replace(found, alike=survey.alike)


@dataclass(frozen=True)
class _Survey:
    """Fits with the roughness held at levels of the search's table: outwards from the one found, as far as they explain
    the photographs as well as any before, and one beyond.

    Attributes:
        fits: from the lowest to the highest.
        roughness: theirs.
        nearest: which of them has the roughness found.
        squares: of their residuals; see `_squares`.
    """

    fits: tuple[Fit, ...]
    roughness: tuple[float, ...]
    nearest: int
    squares: Float[Tensor, "a p"]

    @staticmethod
    def of(problem: Problem, fit: Fit) -> _Survey:
        coarse = problem.on_search_pixels
        levels = list(_levels(coarse.search_table))
        apart = [abs(math.log(_middle(level) / roughness_of(fit))) for level in levels]
        start = apart.index(min(apart))
        first = next_round(coarse, fit, levels[start])
        survey = _Survey((first,), (_middle(levels[start]),), 0, _squares(first, first)[None])
        for level in levels[start + 1 :]:
            survey = survey._with(next_round(coarse, survey.fits[-1], level), level, above=True)
            if not survey.as_good[-1]:
                break
        for level in reversed(levels[:start]):
            survey = survey._with(next_round(coarse, survey.fits[0], level), level, above=False)
            if not survey.as_good[0]:
                break
        return survey

    def _with(self, fit: Fit, level: LightTable, above: bool) -> _Survey:
        """One more at an end."""
        fits, roughness, squares = (fit,), (_middle(level),), _squares(fit, self.fits[self.nearest])[None]
        if above:
            more = (self.fits + fits, self.roughness + roughness, self.nearest, torch.cat([self.squares, squares]))
        else:
            more = (fits + self.fits, roughness + self.roughness, self.nearest + 1, torch.cat([squares, self.squares]))
        return _Survey(*more)

    @property
    def as_good(self) -> Bool[Tensor, " a"]:
        """Which explain the photographs as well as the best."""
        return as_good(self.squares)

    @property
    def best(self) -> Fit:
        return self.fits[int(self.squares.sum(1).argmin())]

    @property
    def alike(self) -> Alike:
        """The span of roughnesses that are as good, to the next that are not; and what the rest does in it."""
        inside = self.as_good.clone()
        inside[self.nearest] = True
        known = inside.nonzero()[:, 0].tolist()
        low, high = max(known[0] - 1, 0), min(known[-1] + 1, len(self.fits) - 1)
        x = torch.stack([self.fits[each].x for each in known])
        moved = x - self.fits[self.nearest].x
        moved[:, self.fits[0].residuals.coordinates.slices["width"]] = 0.0
        return Alike((self.roughness[low], self.roughness[high]), moved)


def _squares(fit: Fit, like: Fit) -> Float[Tensor, " p"]:
    """r_A · r_B of each pixel, weighed as by another fit of them: the table's noise is no misfit."""
    whitening = like.residuals.robust_whitening(like.x)
    first, second = (torch.einsum("prc,pc->pr", whitening, half.difference(fit.x)) for half in fit.residuals.halves)
    return (first * second).sum(1)


def _levels(table: LightTable) -> Iterator[LightTable]:
    """Each of the table's levels as a table of its own."""
    for index, roughness in enumerate(table.roughnesses):
        light = table.light[:, index : index + 1]
        yield replace(table, light=light, low=roughness * (1 - NARROW), high=roughness * (1 + NARROW))


def _middle(level: LightTable) -> float:
    """Its roughness."""
    return (level.low + level.high) / 2
