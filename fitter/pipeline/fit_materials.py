"""The fit of each of an object's materials from its own pixels."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fit_material.fitter.effects.planner import is_traced
from fit_material.fitter.estimation.background_calibration import nuisances_of
from fit_material.fitter.estimation.model_selection import Choice, fit_type
from fit_material.fitter.estimation.problem import Problem
from fit_material.fitter.estimation.viewer_roughness import viewer_roughness
from fit_material.fitter.fitted.determinability import seen_by
from fit_material.fitter.fitted.nuisance_estimates import guessed, turned
from fit_material.fitter.fitted.part import FittedPart
from fit_material.fitter.fitted.summary import fitted_material
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.textured_pixels import MultiViewPixels
from fit_material.fitter.least_squares.nuisances import Nuisances
from fit_material.fitter.least_squares.solvers import SOLVERS, Solver
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.metal_prior.substitution import borrow
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import Observations
from fit_material.fitter.observations.scene_data import Loaded, kinds_of
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.fitter.options.fit_options import FitOptions, Prior
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.pipeline.pixels_by_count import PixelsByCount
from fit_material.fitter.result.schema import Nearest
from fit_material.fitter.uncertainty.active_bound import reported
from fit_material.renderer.rays.gbuffer import Tracer
from fit_material.shaders.materials.kinds import MaterialType

MOST_TRACED = 4000  # pixels, of which paths take a minute or two; what they leave uncertain in F0 is a thousandth


def fit_parts(
    loaded: Loaded,
    trace: Tracer,
    lighting: Lighting,
    options: FitOptions,
    progress: Progress,
    scene_file: Path,
    kinds: Sequence[MaterialType | None] | None = None,
    kept: Collection[int] = (),
) -> list[FittedPart]:
    """Each material from its own pixels.

    Args:
        loaded, trace, lighting, options: what there is, and how to fit it.
        progress: called with the stage and the fraction of it done.
        scene_file: for the sentences of errors.
        kinds: types of the materials, None to find them; as scene file and options give them where left out.
        kept: materials of which pixels are taken though they mirror the object.
    """
    types = kinds_of(loaded, options) if kinds is None else kinds
    nuisances = nuisances_of(loaded, trace)
    request = PixelRequest(
        photographs=loaded.photographs,
        trace=trace,
        scene_file=scene_file,
        materials=len(loaded.materials),
        footprint=lighting.fidelity.footprint,
        seed=options.seed,
        left_out=loaded.repeated,
        kept=kept,
        progress=lambda share: progress("choosing pixels", share),
    )
    pixels = PixelsByCount(request, by_points="color" in options.maps)
    parts = []
    for index, observed in enumerate(pixels.of(_first_count(lighting.fidelity, options.tolerance))):
        if observed is None:
            continue
        label = _labelled(progress, loaded.materials[index], len(loaded.materials))
        problems = _Problems(pixels, index, lighting, SOLVERS[options.solver], label, nuisances)
        name, kind = loaded.materials[index], types[index]
        parts.append(_fitted_part(index, name, problems, kind, options.tolerance, options.prior))
    return parts


def _first_count(fidelity: Fidelity, tolerance: float | None) -> int:
    """Pixels of the first fit."""
    if tolerance is None:
        return fidelity.pixels
    from fit_material.fitter.uncertainty.tolerance import FIRST_PIXELS

    return FIRST_PIXELS


@dataclass(frozen=True)
class _Problems:
    """The least-squares problems of one material, with as many pixels and as exact light as a fidelity requires.

    Attributes:
        pixels: of all materials.
        index: of the material among the mesh's.
        lighting: the light; its fidelity is the requested one.
        solver, progress, nuisances: as of `Problem`.
    """

    pixels: PixelsByCount
    index: int
    lighting: Lighting
    solver: Solver
    progress: Progress
    nuisances: Nuisances | None

    def at(self, fidelity: Fidelity) -> Problem:
        """The problem at a fidelity."""
        observed = self.pixels.of(fidelity.pixels)[self.index]
        assert observed is not None
        light = replace(self.lighting, fidelity=fidelity)
        return Problem(observed, light, self.solver, self.progress, nuisances=self.nuisances)


def _fitted_part(
    index: int,
    name: str,
    problems: _Problems,
    kind: MaterialType | None,
    tolerance: float | None,
    prior: Prior,
) -> FittedPart:
    """One material: by the fidelity, or by as much of it as a tolerance takes."""
    fidelity = problems.lighting.fidelity
    if tolerance is None:
        problem = problems.at(fidelity)
        return _part(index, name, problem.observed, fit_type(problem, kind), problem.lighting, prior)
    from fit_material.fitter.uncertainty.tolerance import ascend

    ascent = ascend(problems.at, fidelity, kind, tolerance)
    problem = ascent.problem
    return _part(index, name, problem.observed, ascent.choice, problem.lighting, prior).by(ascent)


def polished_parts(
    loaded: Loaded, parts: Sequence[FittedPart], options: FitOptions, progress: Progress
) -> list[FittedPart]:
    """The metals again, each in the light that the others send it; the rest as it was."""
    from fit_material.fitter.effects.interreflection import polish_scene, polished

    found = {part.index: part.choice.fit.material for part in parts}

    def again(part: FittedPart) -> FittedPart:
        if not is_traced(found[part.index].type):
            return part.remarked("Mitsuba's paths are traced for metals alone, and left it as it was.")
        label = _labelled(progress, part.material.name, len(parts))
        unhindered = replace(part.lighting, occluder=None)  # what the object hides, the paths know
        few = part.observed[:: -(-len(part.observed.radiance) // MOST_TRACED)]
        fit = part.choice.fit
        gains = fit.residuals.gains
        nuisances = None
        if gains is not None:
            nuisances = gains.nuisances.with_rotation_found(fit.residuals.nuisance_part(fit.x), part.spread.covariance)
        problem = Problem(few, unhindered, SOLVERS[options.solver], label, nuisances=nuisances)
        polish = polished(problem, part.choice.fit, polish_scene(loaded, part.lighting, found, part.index))
        choice = replace(part.choice, fit=polish.fit)
        made = _part(part.index, part.material.name, few, choice, unhindered, options.prior)
        made = replace(made, polish=polish)
        return made if part.ascent is None else made.by(part.ascent.followed_by(polish.fit, problem))

    return [again(part) for part in parts]


def _labelled(progress: Progress, name: str, count: int) -> Progress:
    """Progress that names the material where there are several."""
    return progress if count == 1 else lambda stage, share: progress(f"{name}: {stage}", share)


def _part(
    index: int, name: str, observed: Observations, choice: Choice, lighting: Lighting, prior: Prior
) -> FittedPart:
    fit, uncertainty = reported(choice.fit)
    choice = replace(choice, fit=fit)
    lighting = turned(lighting, fit)
    coordinates = fit.residuals.coordinates
    nearest: tuple[Nearest, ...] = ()
    if isinstance(coordinates, MetalCoordinates):
        from fit_material.fitter.metal_prior.nearest_metals import nearest_metals

        nearest = nearest_metals(fit.x, coordinates, uncertainty)
    rho = None
    if not lighting.fidelity.blurs and fit.material.width is not None:
        model = fit.residuals.model
        tint = None
        if isinstance(model, MultiViewPixels) and fit.material.color is not None:
            tint = model.tint(fit.material)
        rho = viewer_roughness(observed.measured, lighting.viewers, fit.material, tint)
    borrowed = borrow(fit, uncertainty, prior)
    material = fitted_material(name, fit, uncertainty, rho, nearest, borrowed)
    seen = seen_by(fit, observed, guessed(fit, uncertainty))
    return FittedPart(index, observed, choice, uncertainty, material, lighting, seen, borrowed)
