"""Every rung's figures over all cases, as a table; and how far the standard preset is from the knee."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence

import numpy as np

from fit_material.fitter.frontier.pareto import Frontier, Row, Spread
from fit_material.fitter.frontier.table import MEBIBYTE, two_digits
from tests.bench.setting import spread

SHOWN = {"worst": "worst error, %", "f0": "F0, %", "alpha": "alpha, %"}
LATE = 90
KNEE_GOAL = 2.0


def row_of(frontier: Frontier, rung: str) -> Row | None:
    """The row of a rung; None where it was not run."""
    return next((row for row in frontier.rows if row.rung == rung), None)


def rungs_of(frontiers: Sequence[Frontier]) -> list[str]:
    """All rungs, in the ladder's order."""
    return list(dict.fromkeys(row.rung for frontier in frontiers for row in frontier.rows))


def seconds(frontiers: Sequence[Frontier], rung: str) -> list[float]:
    """Of the whole command, the median of each case; infinite where a run failed."""
    return [_median(row and row.seconds["command"]) for row in _rows(frontiers, rung)]


def errors(frontiers: Sequence[Frontier], rung: str, key: str = "worst") -> list[float]:
    """The median of each case; infinite where the fit has no such number, or took the material for another type."""
    return [_median(row and row.errors[key]) for row in _rows(frontiers, rung)]


def _rows(frontiers: Sequence[Frontier], rung: str) -> list[Row | None]:
    return [row_of(frontier, rung) for frontier in frontiers]


def _median(found: Spread | None) -> float:
    return math.inf if found is None else found.median


def medians_table(frontiers: Sequence[Frontier]) -> Iterator[str]:
    """Lines of Markdown."""
    yield f"| rung | s | memory, MiB | {' | '.join(SHOWN.values())} | knee |"
    yield "|---|---|---|" + "---|" * (len(SHOWN) + 1)
    for rung in rungs_of(frontiers):
        peaks = [_median(row and row.peak) / MEBIBYTE for row in _rows(frontiers, rung)]
        found = [_middle_and_late(errors(frontiers, rung, key)) for key in SHOWN]
        knees = sum(frontier.knee == rung for frontier in frontiers)
        cells = (rung, spread(seconds(frontiers, rung)), f"{statistics.median(peaks):.0f}", *found)
        yield f"| {' | '.join(cells)} | {knees} of {len(frontiers)} |"
    yield ""
    yield f"Over {len(frontiers)} cases: seconds median (range), memory median, errors median, {LATE}th percentile (–"
    yield "where so many fits have no such number); in how many cases the rung was the knee."


def _middle_and_late(values: Sequence[float]) -> str:
    late = float(np.percentile(values, LATE, method="higher"))
    return f"{_percent(statistics.median(values))}, {_percent(late)}"


def _percent(share: float) -> str:
    return two_digits(100 * share) if math.isfinite(share) else "–"


def over_the_knee(frontiers: Sequence[Frontier], rung: str = "standard") -> list[float]:
    """A rung's seconds over the knee's, of each case that has a knee and both times."""
    pairs = [
        (own, _median(row and row.seconds["command"]))
        for frontier, own in zip(frontiers, seconds(frontiers, rung), strict=True)
        if frontier.knee is not None
        for row in [row_of(frontier, frontier.knee)]
    ]
    return [own / knee for own, knee in pairs if math.isfinite(own)]


def knee_sentence(frontiers: Sequence[Frontier]) -> str:
    """How far the standard preset is from the knee, and in how many cases within the goal."""
    ratios = over_the_knee(frontiers)
    if not ratios:
        return "No case has both a knee and the standard preset."
    within = sum(ratio <= KNEE_GOAL for ratio in ratios)
    return (
        f"The standard preset takes {spread(ratios)} times the knee's seconds;"
        f" {within} of {len(ratios)} cases are within the goal of {KNEE_GOAL:g}."
    )
