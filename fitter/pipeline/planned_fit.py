"""The fit by a plan, which is made before anything is known and revised by the fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fit_material.fitter.effects.planner import Planner
from fit_material.fitter.fitted.part import FittedPart
from fit_material.fitter.fitted.planned import PlannedFit
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.observations.scene_data import Loaded, kinds_of
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.pipeline.fit_materials import fit_parts, polished_parts
from fit_material.renderer.rays.gbuffer import Tracer
from fit_material.shaders.materials.kinds import MaterialType

ROUNDS = 3


def fit_planned(
    loaded: Loaded, trace: Tracer, lighting: Lighting, options: FitOptions, progress: Progress, scene_file: Path
) -> PlannedFit:
    """Fit with the effects that are called for; again, `ROUNDS` times at most, where what was found calls for more.

    What is no longer called for moves no pixel by more than the tolerance: it is dropped without another fit.
    """
    planner = Planner(loaded, trace, lighting, options)
    kinds = kinds_of(loaded, options)
    progress("planning", 0)
    plan = planner.plan(kinds)
    kept = planner.kept(plan, kinds)
    told: list[str] = []
    for rounds_left in reversed(range(ROUNDS)):
        parts = fit_parts(loaded, trace, planner.simulating(plan), options, progress, scene_file, kinds, kept)
        kinds = _found_kinds(parts, kinds)
        if rounds_left and set(planner.kept(plan, kinds)) > set(kept):
            told.append("The type once found, pixels that mirror the object itself were fitted as well.")
            kept = planner.kept(plan, kinds)
            continue
        if plan["interreflection"].on:
            parts = polished_parts(loaded, parts, options, progress)
        progress("planning", 0)
        revised = planner.plan(kinds, {part.material.name: part.choice.fit.material for part in parts})
        came, went = revised.changed(plan)
        if came and not rounds_left:
            told.append(f"{', '.join(came)}: called for by what was found, but {ROUNDS} fits did not settle that.")
            break
        told += _sentences(came, went)
        plan, kept = revised, planner.kept(revised, kinds)
        if not came:
            break
    return PlannedFit(parts, plan, told, planner)


def _found_kinds(parts: Sequence[FittedPart], before: Sequence[MaterialType | None]) -> list[MaterialType | None]:
    found: dict[int, MaterialType | None] = {part.index: part.choice.fit.material.type for part in parts}
    return [found.get(index, kind) for index, kind in enumerate(before)]


def _sentences(came: Sequence[str], went: Sequence[str]) -> list[str]:
    added, dropped = "called for by what was found, and added", "not called for by what was found, and dropped"
    return [f"{', '.join(names)}: {words}." for names, words in ((came, added), (went, dropped)) if names]
