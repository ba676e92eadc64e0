"""The arguments of `fit-material advise`; heavy imports are late."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated

import typer

from fitter.printing import say
from fitter.progress import progress_bar
from renderer.errors import InputError


class FittedFidelity(enum.StrEnum):
    preview = "preview"
    standard = "standard"
    reference = "reference"
    viewer = "viewer"  # which is refused with the reason


class FittedLobe(enum.StrEnum):
    ggx = "ggx"
    beckmann = "beckmann"


class FittedType(enum.StrEnum):
    auto = "auto"
    metal = "metal"
    glossy = "glossy"
    matte = "matte"


def advise(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml")],
    result: Annotated[
        Path | None, typer.Option(metavar="RESULT.json", help="What `fit` made of this scene; else it is fitted first.")
    ] = None,
    fidelity: Annotated[
        FittedFidelity | None,
        typer.Option(
            metavar="[preview|standard|reference]",
            help="Of the fit whose intervals are to shrink; standard where left out, or the result's.",
        ),
    ] = None,
    type_: Annotated[
        FittedType | None, typer.Option("--type", help="Of materials that the scene leaves open, without --result.")
    ] = None,
    lobe: Annotated[FittedLobe | None, typer.Option(help="Distribution of the microfacets, without --result.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print all views that were looked at, as JSON.")] = False,
    device: Annotated[str, typer.Option(help="Where light is integrated: cpu, cuda, cuda:1 …")] = "cpu",
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")] = False,
) -> None:
    """Say from where a further photograph would shrink the intervals most; writes nothing."""
    if result is not None:
        for option, value in (("--fidelity", fidelity), ("--type", type_), ("--lobe", lobe)):
            if value is not None:
                raise InputError(option, value=value.value, expected=f"no {option} beside --result, which says it")
    with progress_bar(quiet) as progress:
        progress("starting", 0)
        from fitter.advise import advise as ask
        from fitter.fidelity import preset
        from fitter.pipeline import FitOptions

        chosen = preset((fidelity or FittedFidelity.standard).value, (lobe or FittedLobe.ggx).value)  # type: ignore[arg-type]
        options = FitOptions(chosen, device=device, type=(type_ or FittedType.auto).value)
        advice = ask(scene, options, result, progress)
    say(advice.json_text() if json else advice.text())
