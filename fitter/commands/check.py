"""The arguments of `fit-material check`, and how it prints; heavy imports are late."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fit_material.fitter.command_line.common_options import Quiet, Seed
from fit_material.fitter.command_line.output import say
from fit_material.fitter.command_line.progress_bar import progress_bar

if TYPE_CHECKING:
    from fit_material.fitter.input_checks.finding import Finding

CLEAN, FOUND = 0, 1  # exit codes


def check(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml")],
    json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
    seed: Seed = 0,
    quiet: Quiet = False,
) -> None:
    """Report faults of a scene's photographs, cameras, mesh and light, and their remedies; fits and writes nothing.

    Exit code 0: nothing was found; 1: something was.
    """
    with progress_bar(quiet) as progress:
        progress("starting", 0)
        from fit_material.fitter.input_checks.checks import preflight
        from fit_material.fitter.observations.scene_data import load
        from fit_material.renderer.compute.threads import one_thread_per_operation
        from fit_material.renderer.rays import gbuffer

        progress("reading", 0)
        loaded = load(scene)
        progress("checking", 0)
        with one_thread_per_operation():
            found = preflight(loaded, gbuffer.tracer(loaded.shape), scene, seed)
    say(json_text(found) if json else text(found))
    raise typer.Exit(FOUND if found else CLEAN)


def json_text(found: Sequence[Finding]) -> str:
    """The findings as DESIGN.md's JSON."""
    import json
    from dataclasses import asdict

    return json.dumps({"findings": [asdict(each) for each in found]}, indent=2, ensure_ascii=False, allow_nan=False)


def text(found: Sequence[Finding]) -> str:
    """The findings for a person, a line for each."""
    return "\n".join(f"{each.kind}: {each}" for each in found) or "nothing found that is wrong"
