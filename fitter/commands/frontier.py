"""The arguments of `fit-material frontier`; heavy imports are late."""

from __future__ import annotations

import enum
import shlex
import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from fit_material.fitter.command_line.choices import TypeName
from fit_material.fitter.command_line.common_options import Device, Quiet, output_folder
from fit_material.fitter.command_line.output import say
from fit_material.fitter.command_line.progress_bar import progress_bar
from fit_material.fitter.commands.fit import DONE, NO_MATERIAL
from fit_material.renderer.errors.input_error import InputError


class ErrorName(enum.StrEnum):
    worst = "worst"
    n = "n"
    k = "k"
    f0 = "f0"
    alpha = "alpha"
    color = "color"
    picture = "picture"


def frontier(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml")],
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--out", metavar="PATH", parser=output_folder, help="Folder for table, plot, page, and runs."
        ),
    ],
    choices: Annotated[
        bool, typer.Option("--choices", help="Single choices around the standard rung, in the ladder's place.")
    ] = False,
    rungs: Annotated[
        str | None, typer.Option(metavar="NAME,NAME…", help="Only these rungs; all where left out.")
    ] = None,
    repeats: Annotated[int, typer.Option(help="Runs of each rung, 1 to 100; seeds are 0, 1, 2 …")] = 3,
    by: Annotated[ErrorName, typer.Option(help="The error that frontier and knee go by.")] = ErrorName.worst,
    type_: Annotated[TypeName, typer.Option("--type", help="Of materials that the scene leaves open.")] = TypeName.auto,
    device: Device = "cpu",
    quiet: Quiet = False,
) -> None:
    """What accuracy costs in time, on your own photographs; goes on where it was interrupted.

    Exit code 1 where fewer than two rungs have a fit to compare.
    """
    from fit_material.fitter.frontier.rungs import CHOICES, LADDER, named

    chosen = named(CHOICES, rungs, always=CHOICES[:1]) if choices else named(LADDER, rungs)
    if not 1 <= repeats <= 100:
        raise InputError("--repeats", value=repeats, expected="a whole number from 1 to 100")
    with progress_bar(quiet) as progress:
        progress("starting", 0)
        from fit_material.fitter.frontier.compare import Question, compare

        asked = Question(scene, chosen, repeats, by.value, choices, type_.value, device)
        found = compare(asked, out, shlex.join(["fit-material", *sys.argv[1:]]), progress)
    from fit_material.fitter.frontier.table import terminal_table

    say(terminal_table(found, shutil.get_terminal_size().columns if sys.stdout.isatty() else None))
    say(f"page: {out / asked.stem}.html")
    compared = [row for row in found.rows if set(row.statuses) != {"failed"}]
    raise typer.Exit(DONE if len(compared) >= 2 else NO_MATERIAL)
