"""The fit of one material of a known type: light tables, a start that knows nothing, and rounds of least squares."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.estimation.equivalent_roughness import Alike
from fit_material.fitter.estimation.problem import Problem
from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.forward.rotated_environment import TurnedPixels
from fit_material.fitter.least_squares.covariance import unbiased
from fit_material.fitter.least_squares.noise import even_whitening, local_whitening, relative_weight, scatter
from fit_material.fitter.least_squares.nuisances import SCANNED, STEPS, NuisanceFactors, RotationBracket
from fit_material.fitter.least_squares.reduced_residuals import ReducedResiduals, condensed, solved
from fit_material.fitter.least_squares.residuals import Residuals
from fit_material.fitter.least_squares.sample_halves import Halves
from fit_material.fitter.least_squares.solvers import ROUGH, Solution
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.linear_starts import widths
from fit_material.fitter.materials.registry import FITTABLE
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.shaders.materials.kinds import KINDS, MaterialType
from fit_material.shaders.materials.types import Material

SEARCH_SCATTER = 0.03  # of the relative difference, while nothing is known of it yet
EXACT = 1e-6  # least scatter, where photographs are noiseless and there is nothing but the rounding of float32 tables
MIDWAY = 4  # times the search's samples, between search and last round
MORE_ROUNDS = 3  # where the roughness runs into an end of the last span


@dataclass(frozen=True)
class Fit:
    """A fit of one type, finished or a draft.

    Attributes:
        residuals: of the last round.
        solution: how the last round's solver ended.
        x: the free vector that was found: the solution, freed of the bias that noise in the table brings.
        solve_seconds: time spent in solvers, over all rounds.
        alike: widths that explain the pixels as well; None where not computed, or where the error covers them.
    """

    residuals: Residuals
    solution: Solution
    x: Float[Tensor, " x"]
    solve_seconds: float
    alike: Alike | None = None

    @property
    def material(self) -> Material:
        return self.residuals.coordinates.material(self.x)

    @cached_property
    def picture(self) -> Float[Tensor, "p 3"]:
        """Of the material found, as the photographs would show it at the observed pixels."""
        return self.residuals.picture(self.x)

    @cached_property
    def condensate(self) -> ReducedResiduals | None:
        """The residuals, condensed; None where they cannot be."""
        return condensed(self.residuals, self.x) if self.residuals.mixes(self.x) else None


def fit_material(problem: Problem, kind: MaterialType) -> Fit:
    """Fit a material of one type to the observed pixels."""
    return _last(rounds(problem, kind))


def rounds(problem: Problem, kind: MaterialType) -> Iterator[Fit]:
    """The draft of one type, and each round by which it is made precise."""
    rough = draft(problem, kind)
    yield rough
    yield from _refinements(problem, rough)


def _last(fits: Iterator[Fit]) -> Fit:
    *_, last = fits
    return last


def draft(problem: Problem, kind: MaterialType) -> Fit:
    """A first fit from a start that knows nothing, by a coarse table over all roughnesses, to the search's pixels.

    Where the environment's rotation is to be fitted, it is sought among a few, and then nearby.
    """
    problem = problem.on_search_pixels
    if not problem.rotation_candidates:
        return _draft(problem, kind)
    costs = [_draft(each, kind).solution.cost for each in problem.rotation_candidates]
    rough = _draft(problem.at_rotation(RotationBracket(SCANNED[costs.index(min(costs))], STEPS[0])), kind)
    return _draft(problem.at_rotation(RotationBracket(_degrees(rough), STEPS[0])), kind)


def _degrees(fit: Fit) -> float:
    """Rotation of the environment against the problem's."""
    return fit.residuals.rotation(fit.x)


def facing(problem: Problem, fit: Fit) -> Problem:
    """The problem with the environment rotated as fitted, if its rotation is unknown."""
    return (
        problem if not problem.rotation_candidates else problem.at_rotation(RotationBracket(_degrees(fit), STEPS[-1]))
    )


def _draft(problem: Problem, kind: MaterialType) -> Fit:
    model, seen = problem.pixels(kind), problem.observed.radiance
    if KINDS[kind].mirrors:
        model = model.under(problem.search_table)
    plain = model.turns[1] if isinstance(model, TurnedPixels) else model
    gains = _guessed(problem, kind, plain)
    factors = 1.0 if gains is None else gains.factors(gains.nuisances.start)
    weight = relative_weight(seen / factors)
    fittable = FITTABLE[kind]
    start = fittable.start(plain, seen / factors, weight)
    width = None if model.table is None else WidthInterval.of(model.table)
    coordinates = fittable.coordinates(start, width, problem.fidelity)
    residuals = Residuals(model, coordinates, seen, even_whitening(weight / factors, SEARCH_SCATTER), gains)
    beside = seen.new_zeros(0) if gains is None else gains.nuisances.start
    solution = problem.solver(residuals, torch.cat([coordinates.free(start), beside]), ROUGH)
    return Fit(residuals, solution, solution.x, solution.seconds)


def _guessed(problem: Problem, kind: MaterialType, model: PixelModel) -> NuisanceFactors | None:
    """The unknown factors of the pixels, exposures of which nothing is known about those of an object of middling
    reflectance."""
    if problem.nuisances is None:
        return None
    photograph, seen = problem.observed.place[:, 0], problem.observed.radiance
    ratio = (seen / model.radiance(_half_reflecting(kind, model))).clamp_min(torch.finfo(seen.dtype).tiny).log()
    guess = torch.zeros(problem.nuisances.photographs, 3, dtype=seen.dtype)
    for each in photograph.unique().tolist():
        guess[each] = ratio[photograph == each].median()
    return NuisanceFactors(problem.nuisances.about(guess), photograph)


def _half_reflecting(kind: MaterialType, model: PixelModel) -> Material:
    """A material that reflects about half of the light; of what width, the median over pixels hardly depends on."""
    levels = [] if model.table is None else widths(model)
    return FITTABLE[kind].half_reflecting(levels[len(levels) // 2] if levels else None)


def refined(problem: Problem, rough: Fit) -> Fit:
    """The draft made precise: finer tables around its roughness, the last of them laid anew where it leaves them."""
    return _last(_refinements(problem, rough))


def refit_nearby(problem: Problem, fit: Fit) -> Fit:
    """The fit of a problem next to whose solution another one's lies, by the finest tables alone."""
    return _last(_finest(facing(problem, fit), fit))


def _refinements(problem: Problem, fit: Fit) -> Iterator[Fit]:
    problem = facing(problem, fit)
    coarse, fidelity = problem.on_search_pixels, problem.fidelity
    samples = min(fidelity.samples, MIDWAY * fidelity.search_samples)
    for factor in fidelity.spans[:-1] if fit.material.mirrors else ():
        span = _span_around(roughness_of(fit), factor, problem.roughness_range)
        fit = next_round(coarse, fit, coarse.table(span, fidelity.levels, samples, "integrating"))
        yield fit
    yield from _finest(problem, fit)


def _finest(problem: Problem, fit: Fit) -> Iterator[Fit]:
    if not fit.material.mirrors:
        for _ in range(1 + MORE_ROUNDS):
            fit = next_round(problem, fit, None)
            yield fit
            if not _turned_away(fit):
                return
            problem = facing(problem, fit)
        return
    fidelity = problem.fidelity
    for _ in range(1 + MORE_ROUNDS):
        span = _span_around(roughness_of(fit), fidelity.spans[-1], problem.roughness_range)
        table = problem.table(span, fidelity.levels, fidelity.samples, "integrating")
        fit = next_round(problem, fit, table, everywhere=True)
        yield fit
        if not left_its_table(problem, fit) and not _turned_away(fit):
            break
        problem = facing(problem, fit)


def next_round(problem: Problem, before: Fit, table: LightTable | None, everywhere: bool = False) -> Fit:
    """The next problem, its noise taken from the differences to the material found so far, and its solution.

    A round that shall determine the material, and not only its neighbourhood, searches all n and k.
    """
    coordinates, kind = before.residuals.coordinates, before.material.type
    model = problem.pixels(kind).under(table)
    if table is not None:
        coordinates = replace(coordinates, width=WidthInterval.of(table))  # type: ignore[call-arg]
    seen = problem.observed.radiance
    gains = before.residuals.gains
    beside = before.residuals.nuisance_part(before.x)
    factors, shown = torch.ones_like(seen), model
    if gains is not None and problem.nuisances is not None:
        nuisances = replace(gains.nuisances, turn=problem.nuisances.turn)
        gains = NuisanceFactors(nuisances, problem.observed.place[:, 0])
        factors = gains.factors(beside)
        shown = model.at(nuisances.steps(beside)) if isinstance(model, TurnedPixels) else model
    whitening = _whitening(problem, shown.radiance(before.material), seen / factors)
    if gains is not None:
        whitening = whitening / factors[:, None]
    observed = problem.observed
    residuals = Residuals(model, coordinates, seen, whitening, gains, observed.clusters, observed.bounded)
    start = torch.cat([coordinates.free(before.material), beside])
    starts = [start, *coordinates.alternative_starts(start)] if everywhere else [start]
    solution = solved(residuals, starts, problem.solver)
    x = unbiased(residuals, solution.x)
    return Fit(residuals, solution, x, before.solve_seconds + solution.seconds)


def _whitening(problem: Problem, picture: Float[Tensor, "p 3"], seen: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3 3"]:
    """What is known of the noise from a picture near the photographs, both as radiance.

    Where the lobe is the viewer's, which follows no photograph closely, differences are the model's and not
    noise: then all photographs' pixels weigh relatively alike.
    """
    if not problem.fidelity.blurs:
        local = local_whitening(picture - seen, picture, problem.neighbours, EXACT, problem.observed.bounded)
        return local * problem.observed.freedom**0.5
    weight, bounded = relative_weight(seen), problem.observed.bounded
    measured = slice(None) if bounded is None else ~bounded
    return even_whitening(weight, max(scatter(((picture - seen) * weight)[measured]), EXACT))


def roughness_of(fit: Fit) -> float:
    material = fit.material
    return 0.0 if material.width is None else float(material.width.value)


def _span_around(roughness: float, factor: float, whole: tuple[float, float]) -> tuple[float, float]:
    """From roughness/factor to roughness·factor, moved inside the whole range."""
    low, high = whole
    centre = min(max(roughness, low * factor), high / factor)
    return centre / factor, centre * factor


def is_roughness_resolved(fit: Fit) -> bool:
    """Whether the picture changes with the roughness by more than its own error; so it is where there is none of it."""
    residuals = fit.residuals
    if residuals.model.table is None or residuals.model.table.light.shape[1] == 1:
        return True
    halves = Halves.at(fit.x, residuals, residuals.robust_whitening(fit.x))
    return bool(halves.resolved[residuals.coordinates.slices["width"]].all())


def _turned_away(fit: Fit) -> bool:
    """Whether the environment's rotation ran out of the turns between which it is interpolated."""
    gains = fit.residuals.gains
    if gains is None or gains.nuisances.turn is None:
        return False
    return abs(_degrees(fit) - gains.nuisances.turn.centre) > gains.nuisances.turn.step


def left_its_table(problem: Problem, fit: Fit) -> bool:
    """Whether the roughness ran into an end of its table's span, in the outer twentieth, that is no end of the whole
    range."""
    span = fit.residuals.coordinates.width
    if span is None:
        return False
    low, high, whole, roughness = span.low, span.high, problem.roughness_range, roughness_of(fit)
    margin = 0.05 * (high - low)
    at_low = roughness < low + margin and low > whole[0] * 1.01
    at_high = roughness > high - margin and high < whole[1] / 1.01
    return at_low or at_high
