"""The table of hard cases: what tests, `fit-material selftest` and docs/hard-cases.md are made of."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import torch

from fit_material.fitter.least_squares.solvers import compiling
from fit_material.fitter.selftest import angles, fits, lights, lobes, materials, photographs
from fit_material.fitter.selftest.experiments.row import Numbers, Row
from fit_material.fitter.selftest.experiments.small_scene import table as _small_table

TOPICS: Mapping[str, tuple[Row, ...]] = MappingProxyType(
    {
        "lobe": lobes.ROWS,
        "angles": angles.ROWS,
        "material": materials.ROWS,
        "light": lights.ROWS,
        "photographs": photographs.ROWS,
        "fit": fits.ROWS,
    }
)

ROWS: tuple[Row, ...] = tuple(row for rows in TOPICS.values() for row in rows)

DTYPES = (torch.float32, torch.float64)


@dataclass(frozen=True)
class Verdict:
    """Whether one row holds in one kind of numbers.

    Attributes:
        topic: of the row.
        numbers: in which it was computed.
        broken: a sentence for each claim that does not hold.
        seconds: it took.
    """

    topic: str
    row: Row
    numbers: Numbers
    broken: tuple[str, ...]
    seconds: float

    @property
    def holds(self) -> bool:
        return not self.broken


def runs(device: torch.device) -> list[tuple[str, Row, Numbers]]:
    """Every row in float64, and in float32 where it is not for `once`."""
    every = [(topic, row) for topic, rows in TOPICS.items() for row in rows]
    return [
        (topic, row, Numbers(dtype, device)) for topic, row in every for dtype in (DTYPES[1:] if row.once else DTYPES)
    ]


def verdicts(
    device: torch.device, told: Callable[[Verdict, float], None] = lambda verdict, share: None
) -> list[Verdict]:
    """All rows, one after another.

    Args:
        device: where formulas and light are computed.
        told: called with each verdict, and the fraction done.
    """
    compiling()  # for two seconds, beside the formulas
    found: list[Verdict] = []
    every = runs(device)
    for topic, row, numbers in every:
        begun = time.perf_counter()
        broken = tuple(row.broken(numbers))
        found.append(Verdict(topic, row, numbers, broken, time.perf_counter() - begun))
        told(found[-1], len(found) / len(every))
    _small_table.cache_clear()
    return found
