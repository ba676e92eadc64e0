"""The comparison of rungs as a table: for the terminal, as CSV, as JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from typing import Any

from rich.console import Console
from rich.table import Table

from fit_material.fitter.frontier.pareto import ERRORS, STAGES, Frontier, Row, Spread
from fit_material.fitter.result.formatting import WIDTH

MEBIBYTE = 2**20


def terminal_table(frontier: Frontier, width: int | None = None) -> str:
    """Medians of all rows, what they cost and how far off they are, and sentences on what follows."""
    told = sentences(frontier)
    if _repeats(frontier) > 1:
        told.append("The range of the repeats is in the page, and in the .csv and .json beside it.")
    text = io.StringIO()
    console = Console(file=text, width=width or WIDTH, highlight=False)
    for table in (_costs(frontier), _errors(frontier)):
        console.print(table)
        console.print()
    return "\n".join(line.rstrip() for line in [*text.getvalue().splitlines(), *told])


def _costs(frontier: Frontier) -> Table:
    priced = any(row.price for row in frontier.rows)
    table = _table("command", "cpu", *STAGES[:-1], *(["price"] if priced else []), "memory")
    for row in frontier.rows:
        times = [seconds_words(row.seconds[stage]) for stage in ("command", "cpu", *STAGES[:-1])]
        table.add_row(row.rung, *times, *([price_words(row.price)] if priced else []), memory_words(row.peak))
    return table


def _errors(frontier: Frontier) -> Table:
    shown = errors_shown(frontier)
    table = _table(*shown)
    table.add_column("", no_wrap=True)
    for row in frontier.rows:
        table.add_row(row.rung, *(percent(row.errors[key]) for key in shown), verdict(row, frontier))
    return table


def _table(*heads: str) -> Table:
    """A column of names, and numbers below these heads."""
    table = Table(box=None, pad_edge=False)
    table.add_column("rung", no_wrap=True)
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    return table


def errors_shown(frontier: Frontier) -> list[str]:
    """Those of `ERRORS` that any row has."""
    return [key for key in ERRORS if any(row.errors[key] for row in frontier.rows)]


def sentences(frontier: Frontier) -> list[str]:
    """What the numbers mean, and what follows from them."""
    repeats = _repeats(frontier)
    runs = f"medians of {repeats} runs" if repeats > 1 else "of one run each"
    told = [f"Errors are against {frontier.against}; {runs}.", *frontier.gaps]
    told.append("Where errors fall no further, they are the photographs' own noise, and chance ranks the rungs.")
    told.append(f"picture: against the photographs. Who beats whom goes by {frontier.by!r} and the command's time.")
    if frontier.knee is not None:
        told.append(f"The knee is {frontier.knee}: {frontier.knee_is}.")
    elif any(row.price for row in frontier.rows):
        told.append("Single choices have no knee: compare price and errors with the first row's.")
    else:
        told.append("There is no knee: fewer than three rungs are on the frontier, or it bends the other way.")
    failed = [row for row in frontier.rows if "failed" in row.statuses]
    return told + [f"{row.rung} failed: {' '.join(row.messages)}" for row in failed]


def _repeats(frontier: Frontier) -> int:
    return max((len(row.statuses) for row in frontier.rows), default=0)


def verdict(row: Row, frontier: Frontier) -> str:
    """In a word or three."""
    if "failed" in row.statuses:
        return "failed"
    if row.rung == frontier.knee:
        return "knee"
    if row.is_reference:
        return "the others' measure"
    if row.beaten_by is not None:
        return f"beaten by {row.beaten_by}"
    return "on the frontier" if row.rung in frontier.frontier else ""


def seconds_words(spread: Spread | None) -> str:
    return "–" if spread is None else f"{spread.median:.2f} s"


def price_words(spread: Spread | None) -> str:
    return "–" if spread is None else f"{spread.median:.2f} ×"


def memory_words(spread: Spread | None) -> str:
    return "–" if spread is None else f"{spread.median / MEBIBYTE:.0f} MiB"


def percent(spread: Spread | None) -> str:
    return "–" if spread is None else f"{two_digits(100 * spread.median)} %"


def two_digits(value: float) -> str:
    """Two significant digits, without exponent as far as they can be read so."""
    return f"{float(f'{value:.2g}'):g}"


def csv_text(frontier: Frontier) -> str:
    """A line for each rung; of each number median, low and high, errors as shares of 1, memory in bytes."""
    text = io.StringIO()
    rows = [dict(_cells(row, frontier)) for row in frontier.rows]
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _cells(row: Row, frontier: Frontier) -> Iterator[tuple[str, Any]]:
    yield "rung", row.rung
    yield "options", " ".join(row.options)
    yield "statuses", " ".join(row.statuses)
    yield "verdict", verdict(row, frontier)
    spreads = {f"seconds_{stage}": row.seconds[stage] for stage in ("command", "cpu", *STAGES)}
    spreads |= {"price": row.price, "peak_bytes": row.peak}
    spreads |= {f"error_{key}": row.errors[key] for key in ERRORS}
    for name, spread in spreads.items():
        for part in ("median", "low", "high"):
            yield f"{name}_{part}", "" if spread is None else getattr(spread, part)


def json_text(frontier: Frontier) -> str:
    """All of it, strict JSON."""
    data = {"format": 1, **frontier.model_dump(mode="json")}
    return json.dumps(data, allow_nan=False, ensure_ascii=False, indent=2) + "\n"
