"""As accurate as requested, and no more: fits of growing effort until no determined number is expected to move further.

A fit knows the standard error of each number, and by its light table's halves which share of that the integration
brought. More pixels lessen all of it, more samples that share, more roughness levels what interpolation between them
leaves; so the cheapest effort that should do is known before it is spent.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit, Problem, refit_nearby
from fit_material.fitter.estimation.model_selection import Choice, fit_type
from fit_material.fitter.estimation.roughness_survey import surveyed
from fit_material.fitter.least_squares.covariance import integration_share, intervals95, is_determined, standard_errors
from fit_material.fitter.least_squares.jacobian import jacobian
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.fitter.result.schema import Rung, Tolerance
from fit_material.fitter.uncertainty.active_bound import reported
from fit_material.fitter.uncertainty.estimates import (
    Measured,
    is_width,
    name_of,
    reported_quantities,
    resolution,
    value_of,
    width_of,
)
from fit_material.renderer.errors.input_error import InputError
from fit_material.shaders.materials.kinds import MaterialType
from fit_material.shaders.materials.quantities import Quantity

SURE = 2.1  # standard errors that the largest of ten errors keeps to in 95 %: 1.96 where one dwarfs all others
AIM = 0.8  # of the tolerance: an effort is chosen by errors that are themselves estimates
FIRST_PIXELS, FIRST_SAMPLES, FIRST_LEVELS = 3000, 256, 5  # of fewer levels no error of interpolation can be estimated
LAST_SAMPLES, LAST_LEVELS = 8192, 9
MOST_RUNGS = 6
GROWTH = (1, 1.5, 2, 3, 4, 6, 8, 12)  # of pixels or samples from one rung to the next
PER_PIXEL = 1200  # samples that take as long as all else that a pixel costs, rays and errors above all
INTERPOLATED = 0.25  # share of the tolerance from which interpolation between levels calls for more of them


@dataclass(frozen=True)
class Ascent:
    """How a tolerance was met or missed.

    Attributes:
        asked: the tolerance.
        begun: when, by the clock that counts seconds.
        choice: the last fit.
        problem: what it was a fit of.
        rungs: all efforts, the last one last.
        hopeless: numbers that no effort brings within the tolerance, and how far off each may be with all of it.
    """

    asked: float
    begun: float
    choice: Choice
    problem: Problem
    rungs: tuple[Rung, ...]
    hopeless: dict[str, float]

    @property
    def reached(self) -> bool:
        """Whether no determined number is expected to move by more; never where none is determined."""
        movement = self.rungs[-1].movement
        return movement is not None and movement <= self.asked

    @property
    def sentence(self) -> str:
        """The same for a person."""
        last = self.rungs[-1]
        if last.movement is None:
            return f"No number is determined, so that none can keep to {self.asked:.2g}."
        spent = f"after {last.seconds:.1f} s of fitting, with {last.pixels} pixels of {last.samples} samples"
        moves = f"no determined number but the viewer's roughness is expected to be off by over {_share(last.movement)}"
        if self.reached:
            return f"{moves[0].upper()}{moves[1:]} ({last.of}), {_share(self.asked)} were asked for; {spent}."
        worst = ", ".join(f"{name} {_share(left)}" for name, left in self.hopeless.items())
        why = (
            f"the photographs' own noise leaves {worst}, whatever the effort: more or cleaner photographs would help"
            if self.hopeless
            else f"after {MOST_RUNGS} steps the rest was left"
        )
        return f"The {_share(self.asked)} asked for are not reached: {moves} ({last.of}); {why}; {spent}."

    def followed_by(self, fit: Fit, problem: Problem) -> Ascent:
        """The same with a fit after the last one, whose numbers are reported instead: the promise holds for these."""
        rung = _rung(outlook_of(fit, problem), time.perf_counter() - self.begun)
        return replace(self, problem=problem, choice=replace(self.choice, fit=fit), rungs=(*self.rungs, rung))

    def record(self, name: str) -> Tolerance:
        """The same for `result.json`."""
        return Tolerance(
            material=name, asked=self.asked, reached=self.reached, hopeless=tuple(self.hopeless), rungs=self.rungs
        )


@dataclass(frozen=True)
class Outlook:
    """What a fit expects of itself and of others with more effort.

    Attributes:
        names: of the determined numbers.
        error: their standard errors, relative.
        interpolation: by how much interpolation between roughness levels may have moved them, relative.
        integration: share of their variance that the integration of light brought.
        effort: pixels, samples and levels of the fit.
        available: pixels that could be fitted at most.
    """

    names: tuple[str, ...]
    error: Float[Tensor, " q"]
    interpolation: Float[Tensor, " q"]
    integration: float
    effort: Effort
    available: int

    @property
    def movement(self) -> Float[Tensor, " q"]:
        """How far the numbers may still move, relative: in 95 of 100 fits none moves further."""
        return SURE * self.error + self.interpolation

    def foreseen(self, effort: Effort) -> Float[Tensor, " q"]:
        """The movement that another effort would leave."""
        samples = self.integration * self.effort.samples / effort.samples
        lessened = self.effort.pixels / effort.pixels * (1 - self.integration + samples)
        left = self.interpolation if effort.levels == self.effort.levels else 0 * self.interpolation
        return SURE * self.error * lessened**0.5 + left

    def most(self) -> Effort:
        """All that can be spent."""
        return Effort(max(self.available, self.effort.pixels), LAST_SAMPLES, LAST_LEVELS)

    def hopeful(self, tolerance: float) -> Bool[Tensor, " q"]:
        """Which numbers some effort would bring within the tolerance."""
        return self.foreseen(self.most()) <= tolerance

    def next(self, tolerance: float) -> Effort | None:
        """The cheapest effort expected to bring all that can be within the tolerance; None where they are."""
        hopeful = self.hopeful(tolerance)
        if not (self.movement[hopeful] > tolerance).any():
            return None
        efforts = sorted(self._efforts(tolerance), key=lambda each: each.cost)
        enough = [each for each in efforts if (self.foreseen(each)[hopeful] <= AIM * tolerance).all()]
        return enough[0] if enough else efforts[-1]

    def _efforts(self, tolerance: float) -> Iterator[Effort]:
        """Those within reach of one step, other than the present one."""
        now, most = self.effort, self.most()
        coarse = bool((self.interpolation > INTERPOLATED * tolerance).any())
        levels = min(now.levels + 2, most.levels) if coarse else now.levels
        for pixels, samples in product(GROWTH, GROWTH):
            each = Effort(
                min(round(now.pixels * pixels), most.pixels), min(round(now.samples * samples), most.samples), levels
            )
            if each != now:
                yield each


@dataclass(frozen=True)
class Effort:
    """What accuracy is bought with."""

    pixels: int
    samples: int
    levels: int

    @property
    def cost(self) -> float:
        """In samples."""
        return self.pixels * (PER_PIXEL + self.samples)

    def of(self, fidelity: Fidelity) -> Fidelity:
        """A fidelity with this effort."""
        return replace(fidelity, pixels=self.pixels, samples=self.samples - self.samples % 4, levels=self.levels)


def require_tolerance(tolerance: float, fidelity: Fidelity) -> None:
    """Raises InputError where no fit can be checked against the tolerance."""
    if not 0 < tolerance < 1:
        raise InputError("--tolerance", value=tolerance, expected="a relative movement between 0 and 1, such as 0.01")
    if fidelity.blurs:
        expected = "a lobe of microfacets, whose errors are known: the viewer's blur follows no photograph closely"
        raise InputError("--tolerance", value=f"{tolerance:g} with --fidelity {fidelity.name}", expected=expected)


def ascend(
    problem_at: Callable[[Fidelity], Problem], fidelity: Fidelity, kind: MaterialType | None, tolerance: float
) -> Ascent:
    """Fit with growing effort until no determined number is expected to move by more than the tolerance.

    Numbers that no effort brings so far do not drive it on.

    Args:
        problem_at: the problem at a fidelity.
        fidelity: all that is not `Effort`.
        kind: of the material; None to find it.
        tolerance: relative, in (0, 1).
    """
    begun = time.perf_counter()
    effort = Effort(FIRST_PIXELS, FIRST_SAMPLES, max(FIRST_LEVELS, fidelity.levels))
    problem = problem_at(effort.of(fidelity))
    choice = fit_type(problem, kind)
    rungs: list[Rung] = []
    while True:
        outlook = outlook_of(choice.fit, problem)
        rungs.append(_rung(outlook, time.perf_counter() - begun))
        further = outlook.next(tolerance) if len(rungs) < MOST_RUNGS else None
        if further is None:
            break
        problem = problem_at(further.of(fidelity))
        choice = replace(choice, fit=surveyed(problem, refit_nearby(problem, choice.fit)))
    left = outlook.foreseen(outlook.most())
    hopeless = {name: float(each) for name, each in zip(outlook.names, left, strict=True) if each > tolerance}
    return Ascent(tolerance, begun, choice, problem, tuple(rungs), hopeless)


def outlook_of(fit: Fit, problem: Problem) -> Outlook:
    """What a fit expects."""
    fit, uncertainty = reported(fit)
    coordinates, kind = fit.residuals.coordinates, fit.material.type
    moved = _interpolation(fit)
    names: list[str] = []
    rows = []
    for quantity in reported_quantities(fit.material):

        def number_at(x: Tensor, of: Quantity = quantity) -> Tensor:
            return value_of(coordinates.material(x), of)

        value, error = number_at(fit.x), standard_errors(number_at, fit.x, uncertainty)
        low, high = intervals95(number_at, fit.x, uncertainty)
        off = (jacobian(number_at, fit.x) @ moved).abs()
        for channel, (number, *ends) in enumerate(zip(value.tolist(), low.tolist(), high.tolist(), strict=True)):
            told = Measured(number, float(error[channel]), (ends[0], ends[1]))
            if is_width(quantity):
                told = width_of(fit, told)
            assert told.interval is not None
            if number > 0 and is_determined(resolution(kind, quantity.name), number, told.interval):
                names.append(name_of(quantity, channel if len(value) == 3 else None))
                rows.append((float(error[channel]) / number, float(off[channel]) / number))
    found = torch.tensor(rows, dtype=torch.float64).reshape(-1, 2)
    fidelity, observed = problem.fidelity, problem.observed
    effort = Effort(len(observed.measured.radiance), fidelity.samples, fidelity.levels)
    share = integration_share(fit.residuals, fit.x)
    return Outlook(tuple(names), found[:, 0], found[:, 1], share, effort, observed.available)


def _interpolation(fit: Fit) -> Float[Tensor, " x"]:
    """Movement of the free vector by interpolating one roughness level fewer: more than the remaining error."""
    residuals = fit.residuals
    without = residuals.model.without_highest_level()
    if without is None:
        return torch.zeros_like(fit.x)
    whitening = residuals.robust_whitening(fit.x)
    lost = replace(residuals, model=without).picture(fit.x) - residuals.picture(fit.x)
    shift = torch.einsum("prc,pc->pr", whitening, lost)
    slope = torch.matmul(whitening, residuals.slope(fit.x)).flatten(0, 1)
    prior = jacobian(residuals.prior, fit.x)
    rows, shifts = torch.cat([slope, prior]), torch.cat([shift.flatten(), prior.new_zeros(len(prior))])
    return torch.linalg.lstsq(rows, shifts[:, None], driver="gelsd").solution[:, 0]


def _rung(outlook: Outlook, seconds: float) -> Rung:
    """The record of one effort."""
    effort = outlook.effort
    movement = float(outlook.movement.max()) if len(outlook.names) else None
    worst = outlook.names[int(outlook.movement.argmax())] if len(outlook.names) else None
    return Rung(
        pixels=effort.pixels,
        samples=effort.samples,
        levels=effort.levels,
        movement=movement,
        of=worst,
        seconds=seconds,
    )


def _share(value: float) -> str:
    """In per cent, to three digits however small."""
    return f"{100 * value:.3g} %"
