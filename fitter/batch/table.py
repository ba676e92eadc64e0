"""A batch as a table on the terminal, and the words of a number's cell, which the page has as well."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from fit_material.fitter.batch.summary import WORDS, Scene, Summary, sentence
from fit_material.fitter.result.formatting import WIDTH, decimals
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.shaders.materials.quantities import ALPHA, COLOR, F0

COLUMNS = tuple(quantity.name for quantity in (F0, COLOR, ALPHA))
OPEN = "A question mark: the photographs do not determine the number."


def terminal_table(summary: Summary, width: int | None = None) -> str:
    """A line for each material of each scene, then what went wrong, and how many ended how."""
    text = io.StringIO()
    console = Console(file=text, width=width or WIDTH, highlight=False)
    table = _table(summary)
    console.print(table)
    below = [*problems(summary), sentence(summary)]
    if "?" in text.getvalue():
        below.append(OPEN)
    return "\n".join([*(line.rstrip() for line in text.getvalue().splitlines()), "", *below])


def _table(summary: Summary) -> Table:
    shown = shown_of(summary, COLUMNS)
    table = Table(box=None, pad_edge=False)
    for head in ("scene", "status", "type", *shown, "time"):
        table.add_column(head, justify="right" if head == "time" else "left", overflow="fold")
    for scene in summary.scenes:
        for row in _rows(scene, shown):
            table.add_row(*map(Text, row))
    return table


def _rows(scene: Scene, shown: Sequence[str]) -> Iterator[list[str]]:
    """The scene's first material beside its name, others below."""
    head = [scene.name, WORDS[scene.status]]
    tail = "–" if scene.seconds is None else f"{scene.seconds:.1f} s"
    if not scene.materials:
        yield [*head, "–", *("–" for _ in shown), tail]
    for index, material in enumerate(scene.materials):
        kind = material.type if len(scene.materials) == 1 else f"{material.name}: {material.type}"
        cells = [kind, *(one_line(material, key) for key in shown)]
        yield [*head, *cells, tail] if index == 0 else ["", "", *cells, ""]


def shown_of(summary: Summary, keys: Sequence[str]) -> list[str]:
    """Those of the parameters that any material has."""
    found = [material for scene in summary.scenes for material in scene.materials]
    return [key for key in keys if any(getattr(material, key) is not None for material in found)]


def problems(summary: Summary) -> list[str]:
    """A sentence on every scene without a usable material."""
    return [
        f"{scene.name}: {WORDS[scene.status]}: {scene.message}"
        for scene in summary.scenes
        if scene.status not in ("converged", "pending")
    ]


def one_line(material: FittedMaterial, key: str) -> str:
    """A parameter's values with the largest of their errors: `0.998 0.772 0.343 ± 0.002`."""
    found = list(_numbers(material, key))
    if not found:
        return "–"
    errors = [error for _, error, _ in found if error is not None]
    places = decimals(max(errors)) if errors else 3
    values = " ".join(f"{value:.{places}f}{'' if known else '?'}" for value, _, known in found)
    return f"{values} ± {max(errors):.{places}f}" if errors else values


def lines(material: FittedMaterial, key: str) -> list[str]:
    """A parameter's values, each with its own error."""
    found = []
    for value, error, known in _numbers(material, key):
        places = decimals(error) if error else 3
        with_error = f"{value:.{places}f} ± {error:.{places}f}" if error else f"{value:.{places}f}"
        found.append(with_error if known else f"{with_error}?")
    return found


def _numbers(material: FittedMaterial, key: str) -> Iterator[tuple[float, float | None, bool]]:
    """Value, standard error, and whether the photographs determine it, of each channel; nothing where it has none."""
    parts: list[Any] = [getattr(part, key) for part in (material, material.stderr, material.determined)]
    if parts[0] is None:
        return
    count = 3 if isinstance(parts[0], tuple) else 1
    each = (part if isinstance(part, tuple) else (part,) * count for part in parts)
    for value, error, known in zip(*each, strict=True):
        yield value, error, known is not False
