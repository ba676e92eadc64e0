"""The fit of each of an object's materials from its own pixels."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from fitter.background import nuisances_of
from fitter.beside import guessed, turned
from fitter.choice import Choice, fit_type
from fitter.fidelity import Fidelity
from fitter.fit_options import FitOptions
from fitter.lambertian import reported
from fitter.loading import Loaded
from fitter.nearest import nearest_metals
from fitter.parameters import MetalCoordinates
from fitter.polish import Polish, polish_scene, polished
from fitter.prior import Prior, borrow
from fitter.problem import Problem
from fitter.progress import Progress
from fitter.result import FittedMaterial, MaterialType, Tolerance
from fitter.selection import Observations, choose_pixels
from fitter.setting import Setting
from fitter.solve import SOLVERS
from fitter.spots import choose_spots
from fitter.summary import describe, fitted_material
from fitter.textured_pixels import SpottedPixels
from fitter.tolerance import FIRST_PIXELS, Ascent, ascend
from fitter.uncertainty import Spread
from fitter.verdicts import seen_by
from fitter.viewer_roughness import viewer_roughness
from renderer.gbuffer import GBuffer, Tracer
from shaders.materials import Glossy

if TYPE_CHECKING:
    from fitter.color_map import ColorMap


MOST_TRACED = 4000  # pixels, of which paths take a minute or two; what they leave uncertain in F0 is a thousandth


@dataclass(frozen=True)
class FittedPart:
    """The fit of one of the object's materials.

    Attributes:
        index: of the material among the mesh's.
        observed: its pixels.
        choice: its fit.
        spread: covariance of the fit's free vector.
        material: the numbers to report.
        told: the same in sentences.
        setting: the light, and how accurately it was computed.
        described: the fit in sentences, by its numbers.
        ascent: to the tolerance asked for; None where none was.
        polish: with Mitsuba's paths; None where there was none.
        color_map: the texture of the body; None where it is taken for even.
    """

    index: int
    observed: Observations
    choice: Choice
    spread: Spread
    material: FittedMaterial
    told: str
    setting: Setting
    described: Callable[[FittedMaterial], str]
    ascent: Ascent | None = None
    polish: Polish | None = None
    color_map: ColorMap | None = None

    @property
    def tolerance(self) -> Tolerance | None:
        """How the tolerance asked for was met; None where none was."""
        return None if self.ascent is None else self.ascent.record(self.material.name)

    def renumbered(self, material: FittedMaterial) -> FittedPart:
        """The same with other numbers, of which the sentences then are."""
        rest = self.told.removeprefix(self.described(self.material))
        return replace(self, material=material, told=f"{self.described(material)}{rest}")

    def by(self, ascent: Ascent) -> FittedPart:
        """The same, and how a tolerance was met."""
        return replace(self, told=f"{self.told} {ascent.sentence}", ascent=ascent)


def fit_parts(
    loaded: Loaded,
    trace: Tracer,
    setting: Setting,
    options: FitOptions,
    progress: Progress,
    scene_file: Path,
    kinds: Sequence[MaterialType | None] | None = None,
    kept: Collection[int] = (),
) -> list[FittedPart]:
    """Each material from its own pixels.

    Args:
        loaded, trace, setting, options: what there is, and how to fit it.
        progress: told the stage and its share done.
        scene_file: for the sentences of errors.
        kinds: types of the materials, None to find them; as scene file and options say where left out.
        kept: materials of which pixels are taken though they mirror the object.
    """
    types = kinds_of(loaded, options) if kinds is None else kinds
    nuisances = nuisances_of(loaded, trace)

    @functools.cache
    def chosen(count: int) -> list[Observations | None]:
        def by(choose: Callable[..., list[Observations | None]]) -> list[Observations | None]:
            return choose(
                loaded.photographs,
                trace,
                scene_file,
                count=count,
                footprint=setting.fidelity.footprint,
                seed=options.seed,
                materials=len(loaded.materials),
                left_out=loaded.repeated,
                kept=kept,
                progress=lambda share: progress("choosing pixels", share),
            )

        if "color" not in options.maps:
            return by(choose_pixels)
        spots = by(choose_spots)
        if None not in spots:
            return spots
        return [spot or pixels for spot, pixels in zip(spots, by(choose_pixels), strict=True)]

    def problem_at(fidelity: Fidelity, index: int) -> Problem:
        observed, label = chosen(fidelity.pixels)[index], _labelled(progress, loaded.materials[index], len(seen))
        assert observed is not None
        light = replace(setting, fidelity=fidelity)
        return Problem(observed, light, SOLVERS[options.solver], label, nuisances=nuisances)

    seen = chosen(setting.fidelity.pixels if options.tolerance is None else FIRST_PIXELS)
    return [
        _fitted_part(index, functools.partial(problem_at, index=index), loaded, setting.fidelity, options, types[index])
        for index, observed in enumerate(seen)
        if observed is not None
    ]


def _fitted_part(
    index: int,
    problem_at: Callable[[Fidelity], Problem],
    loaded: Loaded,
    fidelity: Fidelity,
    options: FitOptions,
    kind: MaterialType | None,
) -> FittedPart:
    """One material: by the fidelity, or by as much of it as a tolerance takes."""
    name = loaded.materials[index]
    if options.tolerance is None:
        problem = problem_at(fidelity)
        return _part(index, name, problem.observed, fit_type(problem, kind), problem.setting, options.prior)
    ascent = ascend(problem_at, fidelity, kind, options.tolerance)
    problem = ascent.problem
    return _part(index, name, problem.observed, ascent.choice, problem.setting, options.prior).by(ascent)


def kinds_of(loaded: Loaded, options: FitOptions) -> list[MaterialType | None]:
    """The type of each material where scene file or options tell it."""
    return [loaded.kind(name, options.type) for name in loaded.materials]


def polished_parts(
    loaded: Loaded, parts: Sequence[FittedPart], options: FitOptions, progress: Progress
) -> list[FittedPart]:
    """The metals again, each in the light that the others send it; the rest as it was."""
    found = {part.index: part.choice.fit.material for part in parts}

    def again(part: FittedPart) -> FittedPart:
        if found[part.index].type != "metal":
            return replace(
                part, told=f"{part.told} Mitsuba's paths are traced for metals alone, and left it as it was."
            )
        label = _labelled(progress, part.material.name, len(parts))
        unhindered = replace(part.setting, occluder=None)  # what the object hides, the paths know
        few = part.observed[:: -(-len(part.observed.radiance) // MOST_TRACED)]
        gains = part.choice.fit.residuals.gains
        error = float(part.spread.covariance[-1, -1].sqrt())
        nuisances = None if gains is None else gains.nuisances.with_turn_found(float(part.choice.fit.x[-1]), error)
        problem = Problem(few, unhindered, SOLVERS[options.solver], label, nuisances=nuisances)
        polish = polished(problem, part.choice.fit, polish_scene(loaded, part.setting, found, part.index))
        choice = replace(part.choice, fit=polish.fit)
        made = _part(part.index, part.material.name, few, choice, unhindered, options.prior)
        made = replace(made, polish=polish)
        return made if part.ascent is None else made.by(part.ascent.followed_by(polish.fit, problem))

    return [again(part) for part in parts]


def painted(
    parts: Sequence[FittedPart],
    surface: GBuffer,
    radiance_of: Callable[[FittedPart, GBuffer], Float[Tensor, "p 3"]],
) -> Float[Tensor, "p 3"]:
    """Radiance of pixels [p, k], each by the part whose material it shows, float64."""
    radiance = torch.zeros(len(surface.hit), 3, dtype=torch.float64)
    for part in parts:
        own = surface.material[:, 0] == part.index
        if own.any():
            radiance[own] = radiance_of(part, surface[own])
    return radiance


def _labelled(progress: Progress, name: str, count: int) -> Progress:
    """Progress that names the material where there are several."""
    return progress if count == 1 else lambda stage, share: progress(f"{name}: {stage}", share)


def _part(index: int, name: str, observed: Observations, choice: Choice, setting: Setting, prior: Prior) -> FittedPart:
    fit, uncertainty = reported(choice.fit)
    choice = replace(choice, fit=fit)
    setting = turned(setting, fit)
    coordinates = fit.residuals.coordinates
    nearest = nearest_metals(fit.x, coordinates, uncertainty) if isinstance(coordinates, MetalCoordinates) else ()
    rho = None
    if not setting.fidelity.blurs and fit.material.type != "matte":
        model = fit.residuals.model
        tint = None
        if isinstance(model, SpottedPixels) and isinstance(fit.material, Glossy):
            tint = model.tint(fit.material)
        rho = viewer_roughness(observed.measured, setting.viewers, fit.material, tint)
    borrowed = borrow(fit, uncertainty, prior)
    material = fitted_material(name, fit, uncertainty, rho, nearest, borrowed)
    seen = seen_by(fit, observed, guessed(fit, uncertainty))

    def described(material: FittedMaterial) -> str:
        return describe(choice, material, seen, borrowed)

    return FittedPart(index, observed, choice, uncertainty, material, described(material), setting, described)
