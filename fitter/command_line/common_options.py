"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fit_material.renderer.errors.input_error import InputError


def output_folder(text: str | Path) -> Path:
    """`Path("")` would be this folder, which no user means."""
    if not str(text):
        raise InputError("-o", value='""', expected="a folder that can be written; . is this one")
    return Path(text)


Out = Annotated[
    Path,
    typer.Option(
        "-o", "--out", metavar="PATH", parser=output_folder, help="Folder for the results; made if it is not there."
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
Seed = Annotated[
    int, typer.Option(help="Of everything random; the same seed gives the same files.", min=0, max=2**31 - 1)
]
Device = Annotated[str, typer.Option(help="Where light is integrated: cpu, cuda, cuda:1 …")]
With = Annotated[
    list[str] | None,
    typer.Option("--with", metavar="EFFECT", help="Simulate this effect, whatever `plan` decides; may be repeated."),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without", metavar="EFFECT", help="Leave this effect out, whatever `plan` decides; may be repeated."
    ),
]
