"""Which further photograph would shrink the intervals of a fit most: what `fit-material advise` does.

Cameras all round the object are imagined; the information of each about the fitted material is Fisher's, by the
fit's own model and the noise of the photographs that there are. It takes no photograph, only the light on its pixels.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from fit_material.fitter.fitted.summary import status_of
from fit_material.fitter.forward.lighting import lighting_for
from fit_material.fitter.least_squares.nuisances import require_no_free_nuisances
from fit_material.fitter.next_view.advice import Advice, advice_of
from fit_material.fitter.next_view.candidate_views import viewpoints
from fit_material.fitter.next_view.previous_result import read_earlier_result, require_of_scene
from fit_material.fitter.next_view.view_evaluation import Observer
from fit_material.fitter.observations.scene_data import load
from fit_material.fitter.options.fidelity import PRESETS, Fidelity, preset
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.pipeline.fit_materials import fit_parts
from fit_material.fitter.pipeline.fit_scene import torch_device
from fit_material.fitter.result.schema import Result
from fit_material.renderer.compute.threads import one_thread_per_operation
from fit_material.renderer.errors.input_error import InputError
from fit_material.shaders.materials.kinds import KINDS

EXACT = tuple(name for name, fidelity in PRESETS.items() if not fidelity.blurs)
WHY_EXACT = "the viewer's model sees F0 alone, and follows no photograph closely enough to choose another view"

DOUBT = "The fit stopped without converging, so that this is a guess."


def advise(
    scene_file: Path,
    options: FitOptions,
    result_file: Path | None = None,
    progress: Progress = lambda stage, share: None,
) -> Advice:
    """Rank possible views by their information. Nothing is written.

    Args:
        scene_file: `scene.toml`.
        options: of the fit whose intervals are to shrink; its fidelity is the result's where there is a result.
        result_file: the scene's `result.json`; without it the scene is fitted first.
        progress: called with the stage and the fraction of it done.

    Raises:
        InputError: about the first thing in the input that is wrong; or the fit is one in the viewer's model.
    """
    device = torch_device(options.device)
    progress("reading", 0)
    result = None
    if result_file is not None:
        result = read_earlier_result(result_file)
        options = replace(options, fidelity=_fidelity_of(result, result_file))
    _require_exact(options.fidelity)
    loaded = load(scene_file)
    require_no_free_nuisances(loaded.scene, scene_file, "those that a fit has found")
    if result is not None and result_file is not None:
        require_of_scene(result, result_file, loaded, scene_file)
    with one_thread_per_operation():
        trace = loaded.tracer()
        lighting = lighting_for(loaded, options, device)
        if result is None:
            parts = fit_parts(loaded, trace, lighting, options, progress, scene_file)
            found = tuple(part.material for part in parts)
            status = status_of([part.choice for part in parts], found)
        else:
            found, status = result.materials, result.status
        cameras = [thumbnail.camera for thumbnail in loaded.photographs.thumbnails]
        places = viewpoints(cameras, [photograph.camera for photograph in loaded.scene.photographs], loaded.shape)
        observer = Observer(trace, lighting, loaded.photographs, loaded.materials, progress)
        prospects = observer.prospects(found, [place.camera for place in places])
    advice = advice_of(prospects, places, [thumbnail.name for thumbnail in loaded.photographs.thumbnails])
    return advice if status != "stopped" else advice.model_copy(update={"message": f"{DOUBT} {advice.message}"})


def _fidelity_of(result: Result, file: Path) -> Fidelity:
    """The fidelity that a result was fitted at, before it was polished if it was."""
    name, lobe = result.model.fidelity.partition(",")[0], result.model.lobe
    if name not in EXACT or lobe not in ("ggx", "beckmann"):
        raise InputError(file, "model.fidelity", f"{name} with {lobe}", f"{' or '.join(EXACT)}: {WHY_EXACT}")
    bodies = all(KINDS[each.type].has_body for each in result.materials)
    if not bodies and "conductor" not in result.model.reflectance:
        raise InputError(file, "model.reflectance", result.model.reflectance, f"conductor: {WHY_EXACT}")
    return preset(name, lobe)


def _require_exact(fidelity: Fidelity) -> None:
    if fidelity.blurs or fidelity.reflectance != "conductor":
        raise InputError("--fidelity", value=fidelity.name, expected=f"{' or '.join(EXACT)}: {WHY_EXACT}")
