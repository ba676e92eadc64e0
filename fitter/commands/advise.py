"""The arguments of `fit-material advise`; heavy imports are late."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fit_material.fitter.command_line.choices import FidelityName, LobeName, TypeName
from fit_material.fitter.command_line.common_options import Device, Quiet
from fit_material.fitter.command_line.output import say
from fit_material.fitter.command_line.progress_bar import progress_bar
from fit_material.renderer.errors.input_error import InputError


def advise(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml")],
    result: Annotated[
        Path | None, typer.Option(metavar="RESULT.json", help="What `fit` made of this scene; else it is fitted first.")
    ] = None,
    fidelity: Annotated[
        FidelityName | None,
        typer.Option(
            metavar="[preview|standard|reference]",  # the viewer's is refused with the reason
            help="Of the fit whose intervals are to shrink; standard where left out, or the result's.",
        ),
    ] = None,
    type_: Annotated[
        TypeName | None, typer.Option("--type", help="Of materials that the scene leaves open, without --result.")
    ] = None,
    lobe: Annotated[LobeName | None, typer.Option(help="Distribution of the microfacets, without --result.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print all views that were looked at, as JSON.")] = False,
    device: Device = "cpu",
    quiet: Quiet = False,
) -> None:
    """Say from where a further photograph would shrink the intervals most; writes nothing."""
    if result is not None:
        for option, value in (("--fidelity", fidelity), ("--type", type_), ("--lobe", lobe)):
            if value is not None:
                raise InputError(option, value=value.value, expected=f"no {option} beside --result, which says it")
    with progress_bar(quiet) as progress:
        progress("starting", 0)
        from fit_material.fitter.next_view.advise import advise as ask
        from fit_material.fitter.options.fidelity import preset
        from fit_material.fitter.pipeline.fit_scene import FitOptions

        chosen = preset((fidelity or FidelityName.standard).value, (lobe or LobeName.ggx).value)  # type: ignore[arg-type]
        options = FitOptions(chosen, device=device, type=(type_ or TypeName.auto).value)
        advice = ask(scene, options, result, progress)
    say(advice.json_text() if json else advice.text())
