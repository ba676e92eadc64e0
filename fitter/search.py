"""The fit of one material of a known type: light tables, a start that knows nothing, and rounds of least squares."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitter.catalogue import read_catalogue
from fitter.condensed import Condensed, condensed, solved
from fitter.fidelity import BLUR_RANGE, MICROFACET_RANGE, Fidelity
from fitter.noise import even_whitening, local_whitening, neighbours_of, relative_weight, scatter
from fitter.parameters import Coordinates, GlossyCoordinates, Interval, MatteCoordinates, MetalCoordinates, tint_of
from fitter.pixel_model import PixelModel, central
from fitter.residuals import Residuals
from fitter.result import MaterialType
from fitter.selection import Observations
from fitter.setting import Setting
from fitter.solve import ROUGH, Solution, Solver
from fitter.starts import STARTS
from fitter.textured_pixels import SpottedPixels
from fitter.uncertainty import unbiased
from renderer.transport import LightTable
from shaders import fresnel
from shaders.materials import Material, Metal

Progress = Callable[[str, float], None]

SEARCH_SCATTER = 0.03  # of the relative difference, while nothing is known of it yet
EXACT = 1e-6  # least scatter, where photographs are noiseless and there is nothing but the rounding of float32 tables
MIDWAY = 4  # times the search's samples, between search and last round
MORE_ROUNDS = 3  # where the roughness runs into an end of the last span
DIELECTRIC = Interval(1e-3, 0.5)  # reflectance, of an index of 1.065 on; diamond's is 0.17. What mirrors less is matte


@dataclass(frozen=True)
class Problem:
    """What is to be explained, and by which means.

    Attributes:
        observed: the pixels.
        setting: the light, and how accurately to compute it.
        solver: least squares.
        progress: told the stage and its share done.
    """

    observed: Observations
    setting: Setting
    solver: Solver
    progress: Progress

    @property
    def fidelity(self) -> Fidelity:
        return self.setting.fidelity

    @property
    def whole(self) -> tuple[float, float]:
        """The range of roughness."""
        return BLUR_RANGE if self.fidelity.blurs else MICROFACET_RANGE

    def table(self, span: tuple[float, float], levels: int, samples: int, stage: str) -> LightTable:
        report = functools.partial(self.progress, stage)
        return self.setting.table(self.observed.surface, (*span, levels), samples, report)

    @cached_property
    def coarse(self) -> Problem:
        """The same with the search's pixels alone."""
        every = max(1, round(len(self.observed.radiance) / self.fidelity.search_pixels))
        return self if every == 1 else replace(self, observed=self.observed[::every])

    @cached_property
    def neighbours(self) -> Int[Tensor, "p q"]:
        """Of each pixel, those that are most like it."""
        return neighbours_of(central(self.observed.surface))

    @cached_property
    def search_table(self) -> LightTable:
        """A coarse table over all roughnesses, which all types share."""
        return self.table(self.whole, self.fidelity.search_levels, self.fidelity.search_samples, "searching")

    @cached_property
    def _surface(self) -> PixelModel:
        return self.setting.pixels(self.observed.surface, body=False)

    @cached_property
    def _body(self) -> PixelModel:
        model, observed = self.setting.pixels(self.observed.surface, body=True), self.observed
        if observed.spot is None:
            return model
        return SpottedPixels(model, observed.spot, observed.radiance, relative_weight(observed.radiance))

    def pixels(self, kind: MaterialType) -> PixelModel:
        """The pixels' model, with what that type calls for and nothing else, and without a table so far."""
        return self._surface if kind == "metal" else self._body


@dataclass(frozen=True)
class Fit:
    """A fit of one type, finished or a draft.

    Attributes:
        residuals: of the last round.
        solution: how the last round's solver ended.
        x: the free vector that was found: the solution, freed of the bias that noise in the table brings.
        solve_seconds: time spent in solvers, over all rounds.
    """

    residuals: Residuals
    solution: Solution
    x: Float[Tensor, " x"]
    solve_seconds: float

    @property
    def material(self) -> Material:
        return self.residuals.coordinates.material(self.x)

    @cached_property
    def picture(self) -> Float[Tensor, "p 3"]:
        """Radiance of the material found, at the observed pixels."""
        return self.residuals.model.radiance(self.material)

    @cached_property
    def condensate(self) -> Condensed | None:
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
    """A first fit from a start that knows nothing, by a coarse table over all roughnesses, to the search's pixels."""
    problem = problem.coarse
    model, seen = problem.pixels(kind), problem.observed.radiance
    if kind != "matte":
        model = model.under(problem.search_table)
    weight = relative_weight(seen)
    start = STARTS[kind](model, seen, weight)
    coordinates = _coordinates(start, model, problem.fidelity)
    residuals = Residuals(model, coordinates, seen, even_whitening(weight, SEARCH_SCATTER))
    solution = problem.solver(residuals, coordinates.free(start), ROUGH)
    return Fit(residuals, solution, solution.x, solution.seconds)


def refined(problem: Problem, rough: Fit) -> Fit:
    """The draft made precise: finer tables around its roughness, the last of them laid anew where it leaves them."""
    return _last(_refinements(problem, rough))


def anew(problem: Problem, fit: Fit) -> Fit:
    """The fit of a problem next to whose solution another one's lies, by the finest tables alone."""
    return _last(_finest(problem, fit))


def _refinements(problem: Problem, fit: Fit) -> Iterator[Fit]:
    coarse, fidelity = problem.coarse, problem.fidelity
    samples = min(fidelity.samples, MIDWAY * fidelity.search_samples)
    for factor in fidelity.spans[:-1] if fit.material.type != "matte" else ():
        span = _span_around(_roughness(fit), factor, problem.whole)
        fit = _next_round(coarse, fit, coarse.table(span, fidelity.levels, samples, "integrating"))
        yield fit
    yield from _finest(problem, fit)


def _finest(problem: Problem, fit: Fit) -> Iterator[Fit]:
    if fit.material.type == "matte":
        yield _next_round(problem, fit, None)
        return
    fidelity = problem.fidelity
    for _ in range(1 + MORE_ROUNDS):
        span = _span_around(_roughness(fit), fidelity.spans[-1], problem.whole)
        table = problem.table(span, fidelity.levels, fidelity.samples, "integrating")
        fit = _next_round(problem, fit, table, everywhere=True)
        yield fit
        if not _at_an_end(_roughness(fit), span, problem.whole):
            break


def _next_round(problem: Problem, before: Fit, table: LightTable | None, everywhere: bool = False) -> Fit:
    """The next problem, its noise taken from the differences to the material found so far, and its solution.

    A round that shall say what the material is, and not only where to look, looks for its n and k everywhere.
    """
    coordinates, kind = before.residuals.coordinates, before.material.type
    model = problem.pixels(kind).under(table)
    if table is not None:
        coordinates = replace(coordinates, roughness=_interval(table))  # type: ignore[call-arg]
    seen = problem.observed.radiance
    residuals = Residuals(model, coordinates, seen, _whitening(problem, model.radiance(before.material)))
    start = coordinates.free(before.material)
    starts = [start, *coordinates.elsewhere(start)] if everywhere else [start]
    solution = solved(residuals, starts, problem.solver)
    x = unbiased(residuals, solution.x)
    return Fit(residuals, solution, x, before.solve_seconds + solution.seconds)


def _whitening(problem: Problem, picture: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3 3"]:
    """What is known of the noise from a picture near the photographs.

    Where the lobe is the viewer's, which follows no photograph closely, differences tell of the model and not of
    noise: then all photographs' pixels weigh relatively alike.
    """
    seen = problem.observed.radiance
    if not problem.fidelity.blurs:
        return local_whitening(picture - seen, picture, problem.neighbours, EXACT) * problem.observed.freedom**0.5
    weight = relative_weight(seen)
    return even_whitening(weight, max(scatter((picture - seen) * weight), EXACT))


def _coordinates(start: Material, model: PixelModel, fidelity: Fidelity) -> Coordinates:
    """The unknowns of the start's type; outside the viewer's model dielectrics reflect all channels alike."""
    channels = 3 if fidelity.blurs else 1
    if model.table is None:
        return MatteCoordinates(channels)
    roughness = _interval(model.table)
    if not isinstance(start, Metal):
        return GlossyCoordinates(roughness, Interval(0.0, 1.0) if fidelity.blurs else DIELECTRIC, channels)
    return MetalCoordinates(roughness, None if fidelity.reflectance == "conductor" else _known_tint(start))


def _known_tint(start: Metal) -> Float[Tensor, "3"]:
    """For what sees F0 alone: the tint of the catalogue's metal with the nearest colour."""
    known = [(torch.tensor(m.n, dtype=torch.float64), torch.tensor(m.k, dtype=torch.float64)) for m in read_catalogue()]
    distance = [float((fresnel.normal_reflectance(n, k) - start.f0).norm()) for n, k in known]
    return tint_of(*known[min(range(len(known)), key=distance.__getitem__)])


def _interval(table: LightTable) -> Interval:
    return Interval(table.low, table.high, table.scale == "log")


def _roughness(fit: Fit) -> float:
    material = fit.material
    return 0.0 if material.type == "matte" else float(material.roughness)


def _span_around(roughness: float, factor: float, whole: tuple[float, float]) -> tuple[float, float]:
    """From roughness/factor to roughness·factor, moved inside the whole range."""
    low, high = whole
    centre = min(max(roughness, low * factor), high / factor)
    return centre / factor, centre * factor


def _at_an_end(roughness: float, span: tuple[float, float], whole: tuple[float, float]) -> bool:
    """Whether the roughness ran into an end of its span, in the outer twentieth, that is no end of the whole range."""
    low, high = span
    margin = 0.05 * (high - low)
    at_low = roughness < low + margin and low > whole[0] * 1.01
    at_high = roughness > high - margin and high < whole[1] / 1.01
    return at_low or at_high
