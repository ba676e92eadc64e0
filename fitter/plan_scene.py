"""From a scene file to the plan of its fit: what `fit-material plan` does, without command line or printing."""

from __future__ import annotations

from pathlib import Path

from fitter.consistent import require_consistent
from fitter.devices import torch_device
from fitter.fit_options import FitOptions
from fitter.loading import load
from fitter.parts import kinds_of
from fitter.pipeline import setting_of
from fitter.planning import Planner
from fitter.progress import Progress
from renderer.errors import InputError
from renderer.plan import Plan
from renderer.threads import one_thread_per_operation


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
        setting = setting_of(loaded, options, device)
        planner = Planner(loaded, loaded.tracer(), setting, options)
        if not len(planner.sample.surface.hit):
            expected = "a camera that sees the object's front in the pixels its photograph shows"
            raise InputError(scene_file, "photographs", value="", expected=expected)
        return planner.plan(kinds_of(loaded, options))
