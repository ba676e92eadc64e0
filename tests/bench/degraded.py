"""Photographs as cameras make them: what is still found, and whether the intervals hold."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fit_material.fitter.result.schema import FittedMaterial, Result
from tests.bench.fits import How, attempt_anew
from tests.bench.photographs import truth_of
from tests.bench.snapshots import Snapshot, taken
from tests.bench.types import scene_of

KINDS = ("gold", "red plastic", "clay")
OFF = (1.4, 1.0, 0.7)  # red, green and blue of another white
SNAPSHOTS = (
    Snapshot("8-bit sRGB, 2 % clipped, shot noise 1 %"),
    Snapshot("three exposures merged", stops=(1 / 4, 1.0, 4.0)),
    Snapshot("JPEG quality 85", jpeg=True),
    Snapshot("exposures fitted, surroundings seen", exposure="fit", uneven=1.2, background=True),
    Snapshot("exposures fitted, nothing behind", exposure="fit", uneven=1.2),
    Snapshot("one exposure for all fitted, nothing behind", exposure="common"),
    Snapshot("white off, fitted, surroundings seen", gains=OFF, white_balance="fit", background=True),
    Snapshot("white off, fitted, nothing behind", gains=OFF, white_balance="fit"),
    Snapshot("white off, one for all fitted, nothing behind", gains=OFF, white_balance="common"),
)
KEYS = ("color", "f0", "alpha")
GOALS = {SNAPSHOTS[0].title: "F0 0.02, alpha 5 %", SNAPSHOTS[1].title: "F0 0.01"}


@dataclass(frozen=True)
class Outcome:
    """A fit beside the truth."""

    result: Result | str
    truth: dict

    @property
    def found(self) -> FittedMaterial | None:
        return None if isinstance(self.result, str) else self.result.materials[0]

    def error(self, key: str) -> float | None:
        """Largest over the channels; of alpha relative. None where the material has no such number."""
        found, true = getattr(self.found, key, None), self.truth[key]
        if found is None or true is None:
            return None
        off = np.abs(np.atleast_1d(found) - np.atleast_1d(true)).max()
        return float(off / true if key == "alpha" else off)

    def held(self) -> list[bool]:
        """Whether each 95 % interval holds the truth."""
        held = []
        for key in (*KEYS, "n", "k"):
            ranges = getattr(self.found.interval95, key) if self.found else None
            if ranges is None or self.truth[key] is None:
                continue
            several = isinstance(ranges[0], tuple | list) or ranges[0] is None
            pairs = zip(ranges if several else [ranges], np.atleast_1d(self.truth[key]), strict=True)
            held += [interval[0] <= true <= interval[1] for interval, true in pairs if interval is not None]
        return held

    def determined(self, key: str) -> bool | None:
        """Whether all of a number's channels are."""
        told = getattr(self.found.determined, key) if self.found else None
        return None if told is None else bool(np.all(told))


def rows(
    variant: str, how: How, repeats: int = 1, only: Sequence[str] = (), kinds: Sequence[str] = KINDS
) -> Iterator[str]:
    """Lines of a Markdown table, one for each way of taking photographs and each material."""
    yield f"Sphere in studio_small_03, three views of 128², 1024 samples a pixel, {repeats} draws of noise; {how}."
    yield "Errors: the largest channel's, of alpha relative, the worst draw's; then what was said to be determined."
    yield ""
    yield "| photographs | material | found | color | F0 | alpha | in 95 % interval | s |"
    yield "|---|---|---|---|---|---|---|---|"
    for snapshot in SNAPSHOTS:
        if only and not any(word in snapshot.title for word in only):
            continue
        for kind in kinds:
            yield _row(snapshot, kind, [_outcome(snapshot, kind, seed, variant, how) for seed in range(repeats)])


def _outcome(snapshot: Snapshot, kind: str, seed: int, variant: str, how: How) -> Outcome:
    clean = scene_of(kind, variant)
    with tempfile.TemporaryDirectory() as folder:
        result = attempt_anew(taken(snapshot, clean, Path(folder), seed, variant), how, seed)
    return Outcome(result, truth_of(clean))


def _row(snapshot: Snapshot, kind: str, outcomes: Sequence[Outcome]) -> str:
    goal = f" ({GOALS[snapshot.title]})" if snapshot.title in GOALS else ""
    cells = [_worst(outcomes, key) for key in KEYS]
    held = [each for outcome in outcomes for each in outcome.held()]
    types = ", ".join(dict.fromkeys(_status(each) for each in outcomes))
    seconds = max((each.result.time.total for each in outcomes if not isinstance(each.result, str)), default=0.0)
    share = f"{sum(held)} of {len(held)}"
    return f"| {snapshot.title}{goal} | {kind} | {types} | {' | '.join(cells)} | {share} | {seconds:.0f} |"


def _status(outcome: Outcome) -> str:
    found = outcome.found
    return str(outcome.result) if found is None else f"{found.type}, {outcome.result.status}"  # type: ignore[union-attr]


def _worst(outcomes: Sequence[Outcome], key: str) -> str:
    errors = [error for each in outcomes if (error := each.error(key)) is not None]
    if not errors:
        return ""
    told = max(errors)
    known = all(each.determined(key) for each in outcomes)
    return (f"{told:.2%}" if key == "alpha" else f"{told:.4f}") + ("" if known else "?")
