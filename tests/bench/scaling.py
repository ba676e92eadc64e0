"""Time and memory of a fit against pixels, photographs, environment and samples, each fit a process of its own."""

from __future__ import annotations

import math
import os
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tests.bench.large_photographs import Series
from tests.bench.measured_fit import STAGES, Asked, Measured, measured
from tests.bench.setting import spread

MOST_REPEATS = 3
GIBI, MEBI = 2**30, 2**20
TWELVE_MEGAPIXELS = 4000
UPPER = 3  # points at the upper end, of which a second slope is stated


@dataclass(frozen=True)
class Axis:
    """One thing that grows while all others stay.

    Attributes:
        name: of what grows.
        base: what stays.
        values: in ascending order; those after the first `quick` are left out where there is one repeat.
        asked: from a value to photographs, pixels and samples.
    """

    name: str
    base: str
    values: Sequence[int]
    quick: int
    asked: Callable[[int], tuple[Series, int, int]]


AXES = (
    Axis(
        "pixels",
        "3 photographs of 12 megapixels, environment 1024 wide, 64 samples",
        (10**3, 10**4, 10**5, 3 * 10**5, 10**6, 10**7),
        3,
        lambda value: (Series(3, TWELVE_MEGAPIXELS), value, 64),
    ),
    Axis(
        "photographs",
        "of 12 megapixels (4000 × 3000, JPEG with a mask), 12000 pixels, environment 1024 wide, 512 samples",
        (1, 3, 10, 30, 100),
        3,
        lambda value: (Series(value, TWELVE_MEGAPIXELS), 12_000, 512),
    ),
    Axis(
        "environment",
        "3 photographs of 0.2 megapixels, 12000 pixels, 512 samples; width of the map",
        (256, 512, 1024, 2048, 4096),
        3,
        lambda value: (Series(3, 512, value), 12_000, 512),
    ),
    Axis(
        "samples",
        "3 photographs of 0.2 megapixels, 12000 pixels, environment 1024 wide",
        (64, 256, 1024, 4096),
        3,
        lambda value: (Series(3, 512), 12_000, value),
    ),
)


def rows(variant: str, repeats: int, names: Sequence[str] = ()) -> Iterator[str]:
    """Lines of Markdown tables, one for each axis."""
    repeats, limit = min(repeats, MOST_REPEATS), _limit()
    yield f"Gold ball, `fit --fidelity standard --type metal` but for what the tables say; {repeats} repeats in turn."
    yield f"Median (range) in seconds and GiB; none may hold more than {limit / GIBI:.0f} GiB, half of what is here."
    yield "CPU: seconds of all threads; where others use the machine, too, it tells more than the clock does."
    yield ""
    for axis in AXES:
        if not names or axis.name in names:
            yield from _table(axis, repeats, limit)


def _limit() -> int:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2


def _table(axis: Axis, repeats: int, limit: int) -> Iterator[str]:
    found, failed = _runs(axis, repeats, limit)
    yield f"**{axis.name}**: {axis.base}"
    yield ""
    yield f"| {axis.name} | fitted | {' | '.join(STAGES)} | peak memory |"
    yield "|---|---|" + "---|" * (len(STAGES) + 1)
    for value, runs in found.items():
        yield _row(value, runs)
    yield from (f"| {value} | – | {why} |" + " |" * len(STAGES) for value, why in failed.items())
    yield from _slopes("slope in log–log", found)
    if len(found) > UPPER:
        yield from _slopes(f"… of the last {UPPER}", dict(list(found.items())[-UPPER:]))
    yield ""
    yield from (_by_stage(value, runs) for value, runs in list(found.items())[-1:])
    yield ""


def _runs(axis: Axis, repeats: int, limit: int) -> tuple[dict[int, list[Measured]], dict[int, str]]:
    """The fits of each value, all values in turn; and what those said that failed."""
    values = axis.values if repeats > 1 else axis.values[: axis.quick]
    found: dict[int, list[Measured]] = {value: [] for value in values}
    failed: dict[int, str] = {}
    for _ in range(repeats):
        for value in [value for value in values if value not in failed]:
            series, pixels, samples = axis.asked(value)
            made = measured(Asked(str(series.scene()), pixels, samples, limit))
            if isinstance(made, str):
                failed[value] = made
            else:
                found[value].append(made)
    return {value: runs for value, runs in found.items() if runs}, failed


def _row(value: int, runs: Sequence[Measured]) -> str:
    seconds = " | ".join(spread([run.seconds[stage] for run in runs]) for stage in STAGES)
    return f"| {value} | {runs[0].pixels} | {seconds} | {spread([run.peak / GIBI for run in runs])} |"


def _slopes(label: str, found: Mapping[int, Sequence[Measured]]) -> Iterator[str]:
    """Slopes of the logarithms by least squares over all repeats; nothing for fewer than two values."""
    if len(found) < 2:
        return
    at = [value for value, runs in found.items() for _ in runs]
    every = [run for runs in found.values() for run in runs]
    columns = [[run.seconds[stage] for run in every] for stage in STAGES]
    columns.append([float(run.peak) for run in every])
    told = " | ".join("{:.2f} ± {:.2f}".format(*slope(at, column)) for column in columns)
    yield f"| {label} | | {told} |"


def _by_stage(value: int, runs: Sequence[Measured]) -> str:
    peaks = {stage: statistics.median(run.peaks.get(stage, 0) for run in runs) for stage in runs[0].peaks}
    told = ", ".join(f"{stage} {peak / MEBI:.0f}" for stage, peak in peaks.items())
    return f"Peak memory by stage at {value}, MiB: {told}."


def slope(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """d ln y / d ln x of positive numbers by least squares, and its standard error; nan where two points are all."""
    if len(x) < 3:
        return float(np.polyfit(np.log(x), np.log(y), 1)[0]), math.nan
    line, covariance = np.polyfit(np.log(x), np.log(y), 1, cov=True)
    return float(line[0]), math.sqrt(covariance[0, 0])
