"""From a scene file to the plan of its fit: what `fit-material plan` does, without command line or printing."""

from __future__ import annotations

from pathlib import Path

from fit_material.fitter.effects.plan import Plan
from fit_material.fitter.effects.planner import Planner
from fit_material.fitter.forward.lighting import lighting_for
from fit_material.fitter.observations.scene_data import kinds_of, load
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.pipeline.option_checks import require_consistent
from fit_material.renderer.compute.devices import torch_device
from fit_material.renderer.compute.threads import one_thread_per_operation
from fit_material.renderer.errors.input_error import InputError


def plan_scene(scene_file: Path, options: FitOptions, progress: Progress = lambda stage, share: None) -> Plan:
    """The plan of a scene's fit, before anything is fitted.

    Raises:
        InputError: about the first thing in the input that is wrong.
    """
    device = torch_device(options.device)
    require_consistent(options)
    progress("reading", 0)
    loaded = load(scene_file)
    with one_thread_per_operation():
        progress("planning", 0)
        lighting = lighting_for(loaded, options, device)
        planner = Planner(loaded, loaded.tracer(), lighting, options)
        if not len(planner.sample.surface.hit):
            expected = "a camera that sees the object's front in the pixels its photograph shows"
            raise InputError(scene_file, "photographs", value="", expected=expected)
        return planner.plan(kinds_of(loaded, options))
