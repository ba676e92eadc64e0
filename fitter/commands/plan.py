"""The arguments of `fit-material plan`, and how it prints; heavy imports are late."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fit_material.fitter.command_line.choices import FidelityName, TypeName
from fit_material.fitter.command_line.common_options import Device, Quiet, Seed, With, Without
from fit_material.fitter.command_line.output import say
from fit_material.fitter.command_line.progress_bar import progress_bar

if TYPE_CHECKING:
    from fit_material.fitter.effects.plan import Plan


def plan(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml")],
    type_: Annotated[
        TypeName, typer.Option("--type", help="Of materials that the scene leaves open; auto plans for all.")
    ] = TypeName.auto,
    fidelity: Annotated[FidelityName, typer.Option(help="Of the fit that is planned.")] = FidelityName.standard,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Change of a pixel, relative, from which an effect is called for; 0.01 where left out."),
    ] = None,
    with_: With = None,
    without: Without = None,
    json: Annotated[bool, typer.Option("--json", help="Print the list as JSON.")] = False,
    seed: Seed = 0,
    device: Device = "cpu",
    quiet: Quiet = False,
) -> None:
    """Say which effects the photographs of a scene call for, why, and what each would cost; writes nothing."""
    with progress_bar(quiet) as progress:
        progress("starting", 0)
        from fit_material.fitter.options.fidelity import PRESETS
        from fit_material.fitter.options.fit_options import FitOptions
        from fit_material.fitter.pipeline.plan_scene import plan_scene

        options = FitOptions(
            PRESETS[fidelity.value],
            seed=seed,
            device=device,
            type=type_.value,
            tolerance=tolerance,
            wanted=tuple(with_ or ()),
            unwanted=tuple(without or ()),
        )
        made = plan_scene(scene, options, progress)
    say(json_text(made) if json else text(made))


def json_text(made: Plan) -> str:
    """The plan as DESIGN.md's JSON: share is the most by which an effect moves a pixel, cost its share of the time."""
    import json

    effects = [
        {"name": each.name, "on": each.on, "why": each.why, "share": each.most, "cost": round(made.cost(each.name), 4)}
        for each in made.decisions
    ]
    return json.dumps({"effects": effects}, indent=2, ensure_ascii=False, allow_nan=False)


def text(made: Plan) -> str:
    """The plan for a person, a line for each effect."""
    width = max(len(each.name) for each in made.decisions)
    lines = [
        f"{each.name:{width}}  {'on ' if each.on else 'off'}  {made.cost(each.name):4.0%}  {each.why}"
        for each in made.decisions
    ]
    last = f"An effect is called for where it moves a pixel by more than {made.tolerance:g} of its light."
    return "\n".join([f"{'effect':{width}}       cost  why", *lines, last])
