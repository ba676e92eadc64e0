"""What the fit command costs, and what it finds of a few metals photographed by Mitsuba; `grid` has many more."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fit_material.fitter.result.schema import Result, read_result
from tests.bench.photographs import ALPHAS, METALS, Case, truth_of
from tests.bench.setting import spread


@dataclass(frozen=True)
class Outcome:
    """One fit, and the truth."""

    case: Case
    result: Result
    truth: dict
    seconds: float = 0.0
    bytes: int = 0

    @property
    def f0_error(self) -> float:
        """Largest absolute error of F0 over the channels."""
        return max(abs(a - b) for a, b in zip(self.result.materials[0].f0 or (), self.truth["f0"], strict=True))

    @property
    def alpha_error(self) -> float:
        """Relative error of alpha."""
        return abs((self.result.materials[0].alpha or 0) / self.truth["alpha"] - 1)


def command_rows(variant: str) -> Iterator[str]:
    """The whole `fit` command, as a process of its own, on the sphere in studio_small_03."""
    outcomes = [_by_command(Case(metal, alpha), variant) for metal in METALS for alpha in ALPHAS]
    yield from _table(outcomes)
    yield ""
    yield from _extremes(outcomes)
    times = [outcome.result.time for outcome in outcomes]
    yield f"- whole command: {spread([outcome.seconds for outcome in outcomes])} s wall"
    for part in ("load", "prepare", "solve", "report"):
        yield f"- {part}: {spread([getattr(each, part) for each in times])} s"
    yield f"- peak resident memory: {spread([outcome.bytes / 2**20 for outcome in outcomes])} MiB"


def _by_command(case: Case, variant: str) -> Outcome:
    scene = case.scene(variant)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "fit_material", "fit", str(scene), "-o", folder, "--quiet"]
        begun = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - begun
        process.returncode = os.waitstatus_to_exitcode(status)
        result = read_result(Path(folder) / "result.json")
    return Outcome(case, result, truth_of(scene), seconds, usage.ru_maxrss * 1024)


def _table(outcomes: Sequence[Outcome]) -> Iterator[str]:
    yield "| shape | environment | metal | | alpha | F0 R G B | n R G B | k R G B | rms |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for outcome in outcomes:
        case, found, truth = outcome.case, outcome.result.materials[0], outcome.truth
        quality = outcome.result.quality.overall.rms_relative or 0
        true = " | ".join(_numbers(truth[key]) for key in ("f0", "n", "k"))
        yield f"| {case.shape} | {case.environment} | {case.metal} | true | {truth['alpha']:.4f} | {true} | |"
        values = " | ".join(_with_errors(getattr(found, key), getattr(found.stderr, key)) for key in ("f0", "n", "k"))
        alpha = _with_errors([found.alpha], [found.stderr.alpha])
        yield f"| | | | {outcome.result.status} | {alpha} | {values} | {quality:.1%} |"


def _extremes(outcomes: Sequence[Outcome]) -> Iterator[str]:
    yield f"- error of F0, largest channel: {spread([outcome.f0_error for outcome in outcomes])} absolute"
    yield f"- error of alpha: {spread([100 * outcome.alpha_error for outcome in outcomes])} %"


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.4f}" for value in values)


def _with_errors(values: Sequence[float | None], errors: Sequence[float | None]) -> str:
    pairs = zip(values, errors, strict=True)
    return " ".join(f"{value:.4f}±{'?' if error is None else f'{error:.4f}'}" for value, error in pairs)
