"""The arguments of `fit-material export`; heavy imports are late."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperOption

from fit_material.fitter.command_line.common_options import Out
from fit_material.fitter.command_line.output import say


def export(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json")],
    out: Out,
    to: Annotated[str, typer.Option(help="Formats, separated by commas: {formats}.")] = "thesis,mtl",
    replace: Annotated[
        bool, typer.Option("--replace", help="Overwrite files of other content that have these names; never inputs.")
    ] = False,
) -> None:
    """Write the materials of a result in other programs' formats."""
    from fit_material.fitter.export.export import export as write
    from fit_material.fitter.result.schema import read_result

    formats = [name.strip() for name in to.split(",")]
    for path in write(read_result(result), formats, out, _stem(result), result, replace=replace):
        say(path)


class ListingFormats(TyperCommand):
    """`export`, whose help has the registered formats; other commands' help does without the registry."""

    def get_help(self, ctx: Any) -> str:
        from fit_material.fitter.export.formats import FORMATS

        for option in self.params:
            if isinstance(option, TyperOption) and option.help is not None:
                option.help = option.help.replace("{formats}", ", ".join(FORMATS))
        return super().get_help(ctx)


def _stem(result: Path) -> str:
    """What `fit` called the material's files beside the result, or the folder's name."""
    from fit_material.fitter.export.formats import FORMATS

    folder, ending = result.resolve().parent, FORMATS["thesis"].ending
    names = [path.name.removesuffix(ending) for path in folder.glob(f"?*{ending}")]
    return names[0] if len(names) == 1 else folder.name or "material"
