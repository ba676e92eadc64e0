"""Accuracy against time: what each way to fit costs, how far off it is, which are worth having, and where to stop."""

from __future__ import annotations

import math
import platform
import statistics
from collections.abc import Sequence

from fit_material.fitter.frontier.errors import NUMBERS, Reference, consensus, errors, gaps
from fit_material.fitter.frontier.rungs import Rung
from fit_material.fitter.frontier.runs import Run
from fit_material.fitter.result.provenance import versions
from fit_material.fitter.result.schema import Record
from fit_material.renderer.compute.threads import cores

STAGES = ("load", "prepare", "solve", "report", "total")
ERRORS = (*NUMBERS, "picture", "worst")
LEAST = 1e-9  # of an error, whose logarithm is taken
KNEE = (
    "the rung farthest below the straight line between the ends of the frontier, both axes logarithmic and scaled to"
    " the frontier's extent (Kneedle, Satopää et al. 2011)"
)


class Spread(Record):
    """Median and range over the repeats."""

    median: float
    low: float
    high: float


class Row(Record):
    """What a rung cost and brought.

    Attributes:
        rung, options: what was run.
        statuses: of each run, by seed.
        seconds: of each stage; "command" is the whole process, "cpu" what it took of all cores together.
        price: the command's time over the first rung's with the same seed; None but for single choices.
        peak: memory, bytes.
        errors: of `ERRORS`, shares of 1.
        is_reference: whether the errors are measured against this rung: then its own are the scatter of its repeats.
        beaten_by: the fastest rung that is both faster and nearer, by the medians.
    """

    rung: str
    options: tuple[str, ...]
    statuses: tuple[str, ...]
    messages: tuple[str, ...]
    seconds: dict[str, Spread | None]
    price: Spread | None
    peak: Spread | None
    errors: dict[str, Spread | None]
    is_reference: bool = False
    beaten_by: str | None = None

    def point(self, by: str) -> tuple[float, float] | None:
        """Seconds of the command and the error; None where there is none, or none to compare."""
        time, error = self.seconds["command"], self.errors[by]
        unlike = self.is_reference and by != "picture"
        return None if time is None or error is None or unlike else (time.median, max(error.median, LEAST))


class Frontier(Record):
    """All rows, and what follows from them.

    Attributes:
        scene: its path.
        against: what the errors are measured against, in words.
        gaps: sentences on materials that have no errors.
        by: the error that frontier and knee are made of.
        frontier: the rungs that none beats, from the fastest to the nearest.
        knee: one of them; None where they have none, as single choices have.
        knee_is: its definition.
        machine, versions: where and with what it was measured.
    """

    scene: str
    against: str
    gaps: tuple[str, ...] = ()
    by: str
    rows: tuple[Row, ...]
    frontier: tuple[str, ...]
    knee: str | None
    knee_is: str = KNEE
    machine: str
    versions: dict[str, str]


def frontier_of(
    scene: str,
    rungs: Sequence[Rung],
    runs: Sequence[Run],
    truth: Sequence[Reference] | None,
    by: str = "worst",
    priced: bool = False,
) -> Frontier:
    """The comparison of rungs by their runs.

    Args:
        scene: its path, to be shown.
        rungs: from the cheapest to the finest; of single choices the first is what the others are priced by.
        runs: of all of them.
        truth: the materials as they are; None where errors are to be measured against the finest rung.
        by: one of `ERRORS`.
        priced: whether the rungs are single choices around the first.
    """
    finest = rungs[0] if priced else rungs[-1]
    own = {rung.name: [run for run in runs if run.rung == rung.name] for rung in rungs}
    right = consensus(own[finest.name]) if truth is None else truth
    first = own[rungs[0].name] if priced else None
    rows = [_row(rung, own[rung.name], right, first, truth is None and rung is finest) for rung in rungs]
    rows = [row.model_copy(update={"beaten_by": _beaten_by(row, rows, by)}) for row in rows]
    front = _front(rows, by)
    return Frontier(
        scene=scene,
        against=_against(truth, finest),
        gaps=() if truth is None else gaps(runs, truth),
        by=by,
        rows=tuple(rows),
        frontier=tuple(row.rung for row in front),
        knee=None if priced else knee([(row.rung, row.point(by)) for row in front]),  # type: ignore[misc] — all have points
        machine=f"{platform.machine()}, {cores()} cores, Python {platform.python_version()}",
        versions=versions(),
    )


def _against(truth: Sequence[Reference] | None, finest: Rung) -> str:
    if truth is not None:
        return "the truth, of truth.json beside the scene"
    return f"the finest rung, {finest.name}: no truth.json lies beside the scene, and errors that all share stay hidden"


def _row(
    rung: Rung, runs: Sequence[Run], right: Sequence[Reference], first: Sequence[Run] | None, is_reference: bool
) -> Row:
    done = [run for run in runs if run.time is not None]
    found = [errors(run, right) for run in done]
    seconds = {stage: spread([getattr(run.time, stage) for run in done]) for stage in STAGES}
    return Row(
        rung=rung.name,
        options=rung.options,
        statuses=tuple(run.status for run in runs),
        messages=tuple(dict.fromkeys(run.message for run in runs)),
        seconds={**seconds, **{key: spread([getattr(run, key) for run in done]) for key in ("command", "cpu")}},
        price=None if first is None else _price(done, first),
        peak=spread([run.peak for run in done]),
        errors={key: spread([each[key] for each in found]) for key in ERRORS},
        is_reference=is_reference,
    )


def _price(runs: Sequence[Run], first: Sequence[Run]) -> Spread | None:
    """Ratios of times that were measured side by side."""
    usual = {run.seed: run.command for run in first if run.time is not None}
    return spread([run.command / usual[run.seed] for run in runs if run.seed in usual])


def spread(values: Sequence[float | None]) -> Spread | None:
    """Of the values there are; None where one is missing: the others alone would flatter."""
    if not values or None in values:
        return None
    known = [value for value in values if value is not None]
    return Spread(median=statistics.median(known), low=min(known), high=max(known))


def _beaten_by(row: Row, rows: Sequence[Row], by: str) -> str | None:
    """The fastest of those that are faster and nearer."""
    point = row.point(by)
    points = [(each.point(by), each.rung) for each in rows]
    better = [(at, name) for at, name in points if point and at and at[0] < point[0] and at[1] < point[1]]
    return min(better)[1] if better else None


def _front(rows: Sequence[Row], by: str) -> list[Row]:
    """The rows that none beats, by time."""
    return sorted((row for row in rows if row.point(by) and row.beaten_by is None), key=lambda row: row.point(by))  # type: ignore[arg-type, return-value]


def knee(front: Sequence[tuple[str, tuple[float, float]]]) -> str | None:
    """`KNEE`; None where fewer than three rungs are left, or all lie on or above the line.

    With both axes scaled to [0, 1] and x rising, y falling, the distance below the line x + y = 1 is in proportion to
    1 - x - y, Kneedle's difference curve of a falling, convex function [Satopää et al. 2011, section III].

    Args:
        front: names, with seconds and error, both > 0, from the fastest to the nearest.
    """
    if len(front) < 3:
        return None
    logs = [(math.log(seconds), math.log(error)) for _, (seconds, error) in front]
    (x0, y0), (x1, y1) = logs[0], logs[-1]
    if x1 <= x0 or y0 <= y1:
        return None
    below = [1 - (x - x0) / (x1 - x0) - (y - y1) / (y0 - y1) for x, y in logs]
    best = max(range(len(below)), key=below.__getitem__)
    return front[best][0] if below[best] > LEAST else None
