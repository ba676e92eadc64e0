"""From a scene file to a result on disk: what `fit-material fit` does, without command line or printing.

The stages, each from values to values: load, check, refine, fit, texture, describe, write. The last alone writes files.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from fit_material.fitter.fitted.planned import PlannedFit
from fit_material.fitter.forward.lighting import lighting_for
from fit_material.fitter.least_squares.nuisances import require_no_free_nuisances
from fit_material.fitter.least_squares.solvers import compiling
from fit_material.fitter.observations.scene_data import Loaded, kinds_of, load
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.pipeline.describe_fit import Clock, DescribedFit, FittedScene, describe_fit
from fit_material.fitter.pipeline.map_files import with_map_names
from fit_material.fitter.pipeline.option_checks import require_consistent, require_mappable
from fit_material.fitter.pipeline.output_files import SIZE, require_room_for_outputs
from fit_material.fitter.pipeline.planned_fit import fit_planned
from fit_material.fitter.result.schema import Result, write_result
from fit_material.fitter.result.written_files import outputs_of
from fit_material.renderer.compute.devices import torch_device
from fit_material.renderer.compute.threads import one_thread_per_operation
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import replaced_together, write_bytes_atomically, write_text_atomically
from fit_material.renderer.rays.gbuffer import Tracer

if TYPE_CHECKING:
    from fit_material.fitter.poses.refinement import RefinedPoses


def fit_scene(
    scene_file: Path,
    out: Path,
    options: FitOptions,
    progress: Progress = lambda stage, share: None,
    begun: float | None = None,
    warn: Callable[[str], None] = lambda sentence: None,
    target: Path | None = None,
) -> Result:
    """Fit the materials of a scene and write `result.json`, two MTL files and `report.html` into a folder.

    Files of an earlier result are replaced when all new ones are whole, and not before; files that the scene is read
    from, or that no fit has written, never.

    Args:
        scene_file: `scene.toml`.
        out: folder; made if it is not there.
        options: how to fit.
        progress: called with the stage and the fraction of it done.
        begun: `time.perf_counter()` when the program began, so that its start-up counts as loading.
        warn: called with each fault of the input, if that is checked.
        target: where whoever called moves the files afterwards; `out` where left out.

    Raises:
        InputError: about the first thing in the input that is wrong, or about a file that may not be replaced.
    """
    began = time.perf_counter() if begun is None else begun
    device = torch_device(options.device)
    loaded = _load(scene_file, options, progress)
    final = out if target is None else target
    allowed = require_room_for_outputs(loaded, scene_file, final, options)
    read = time.perf_counter()
    if options.solver == "lm":
        compiling()  # in a thread of its own, beside all that comes before the first solution
    with one_thread_per_operation(), replaced_together(out, replaceable=allowed, size=SIZE) as folder:
        scene = _Scene(scene_file, loaded, loaded.tracer())
        warnings = _check(scene, options.seed, progress, warn) if options.check else []
        lighting = lighting_for(scene.loaded, options, device)
        scene = _refine(scene, options, device, progress) if options.refine_pose else scene
        planned = fit_planned(scene.loaded, scene.trace, lighting, options, progress, scene_file)
        planned = _texture(planned, scene, options, progress) if "color" in options.maps else planned
        solving = sum(part.choice.fit.solve_seconds for part in planned.parts)
        clock = Clock(began, read, time.perf_counter(), scene.loaded.photographs.seconds, solving)
        progress("writing the report", 0)
        fitted = FittedScene(scene.loaded, scene.trace, planned, scene.refined, warnings)
        return _write(describe_fit(fitted, clock, options.command), folder, final, clock)


@dataclass(frozen=True)
class _Scene:
    """A scene that was read.

    Attributes:
        file: `scene.toml`.
        loaded: its contents, with the cameras where they are taken to stand.
        trace: rays at its object.
        refined: how the cameras were moved; None where they were not.
    """

    file: Path
    loaded: Loaded
    trace: Tracer
    refined: RefinedPoses | None = None


def _load(scene_file: Path, options: FitOptions, progress: Progress) -> Loaded:
    """The scene, once it is known that the options go together, and with it."""
    require_consistent(options)
    if options.polish or "interreflection" in options.wanted:
        from fit_material.fitter.effects.interreflection import require_polishable

        require_polishable(options.fidelity)
    progress("reading", 0)
    loaded = load(scene_file)
    require_mappable(loaded.shape, loaded.scene.geometry.mesh, options.maps)
    for option, is_asked in (("--maps", options.maps), ("--refine-pose", options.refine_pose)):
        if is_asked:
            require_no_free_nuisances(
                loaded.scene, scene_file, f"beside {option}: those that a fit without it has found"
            )
    return loaded


def _check(scene: _Scene, seed: int, progress: Progress, warn: Callable[[str], None]) -> list[str]:
    """What is wrong with the input, a sentence each; it stops no fit, and nor does its search."""
    from fit_material.fitter.input_checks.checks import affordable, preflight

    progress("checking the input", 0)
    try:
        most = affordable(scene.loaded.photographs)
        found = [f"Check: {each}." for each in preflight(scene.loaded, scene.trace, scene.file, seed, most)]
    except InputError:  # the fit will report it
        return []
    except Exception as error:
        found = [f"Check: the input could not be checked ({' '.join(str(error).split())})."]
    for sentence in found:
        warn(sentence)
    return found


def _refine(scene: _Scene, options: FitOptions, device: torch.device, progress: Progress) -> _Scene:
    """The scene with its cameras where they stood, found in light that is exact whatever the fit's is."""
    from fit_material.fitter.poses.refinement import pose_fidelity, refine_poses

    lighting = lighting_for(scene.loaded, replace(options, fidelity=pose_fidelity(options.fidelity)), device)
    kinds, varied = kinds_of(scene.loaded, options), bool(options.maps)
    refined = refine_poses(scene.loaded, scene.trace, lighting, kinds, progress, scene.file, varied=varied)
    return replace(scene, loaded=refined.loaded, refined=refined)


def _texture(planned: PlannedFit, scene: _Scene, options: FitOptions, progress: Progress) -> PlannedFit:
    """The fit with its colour maps, which the materials name by the files that they will be."""
    from fit_material.fitter.textures.color_map import with_color_maps

    lit = "interreflection" not in options.unwanted
    planned = with_color_maps(planned, scene.loaded, scene.trace, progress, seed=options.seed, interreflection=lit)
    return replace(planned, parts=with_map_names(planned.parts, scene.loaded.name))


def _write(described: DescribedFit, folder: Path, target: Path, clock: Clock) -> Result:
    """Write every file, and the result with their names last: no page can know how long it took.

    Args:
        described: what to write.
        folder: an empty one.
        target: where the files go from there.
        clock: of the fit.
    """
    for name, content in described.files.items():
        if isinstance(content, str):
            write_text_atomically(folder / name, content)
        else:
            write_bytes_atomically(folder / name, content)
    files = outputs_of(folder, target)
    result = described.result.model_copy(update={"time": clock.now(), **files})
    write_result(result, folder / "result.json")
    return result
