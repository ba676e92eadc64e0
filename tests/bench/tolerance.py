"""Whether `--tolerance` keeps its word: what fits promise of their errors, beside the errors, and what it costs."""

from __future__ import annotations

import math
import statistics
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from fit_material.fitter.frontier import runs as frontier_runs
from fit_material.fitter.frontier.runs import Ended
from fit_material.fitter.result.schema import Result, Rung
from tests.bench.estimates import estimate_of, stated_determined, true_numbers
from tests.bench.fits import attempt, in_processes
from tests.bench.grid import NAMES, SPP, Selection, share
from tests.bench.photographs import Case
from tests.bench.setting import spread

ASKED = 0.01
KEPT_GOAL, PESSIMISM_GOAL = 0.95, 3
COMMANDS = {"--tolerance 0.01": ("--tolerance", str(ASKED)), "--fidelity preview": ("--fidelity", "preview")}
COMMAND_GOALS = {"--tolerance 0.01": 5.0, "--fidelity preview": 2.5}
USUAL_REPEATS = 3


@dataclass(frozen=True)
class Outcome:
    """One fit, and the truth.

    Attributes:
        result: of the fit, or what went wrong.
    """

    case: Case
    result: Result | str

    @property
    def rungs(self) -> Sequence[Rung]:
        """The efforts; none where the fit went wrong."""
        return () if isinstance(self.result, str) or not self.result.tolerance else self.result.tolerance[0].rungs

    @property
    def promised(self) -> float | None:
        """The largest relative movement that is still expected of a determined number; None where none is."""
        return self.rungs[-1].movement if self.rungs else None

    @property
    def errors(self) -> dict[str, float]:
        """Relative errors of the determined numbers, by name; infinite where the fit took the metal for no metal."""
        if isinstance(self.result, str):
            return {}
        found, truth = self.result.materials[0], true_numbers(self.case)
        if found.type != "metal":
            return {"type": math.inf}
        off = np.abs(estimate_of(found).value / truth - 1)
        return {NAMES[i]: float(off[i]) for i in np.flatnonzero(stated_determined(found))}

    @property
    def worst(self) -> tuple[str, float] | None:
        """The largest of the errors, and whose it is."""
        return max(self.errors.items(), key=lambda each: each[1], default=None)

    @property
    def pair(self) -> tuple[float, float] | None:
        """What was promised and what came true; None where there was nothing to promise."""
        return None if self.promised is None or self.worst is None else (self.promised, self.worst[1])

    @property
    def reached(self) -> bool:
        """Whether the fit says that it reached the tolerance."""
        return not isinstance(self.result, str) and bool(self.result.tolerance) and self.result.tolerance[0].reached

    @property
    def seconds(self) -> float:
        """In process; NaN where the fit went wrong."""
        return math.nan if isinstance(self.result, str) else self.result.time.total


def rows(variant: str, selection: Selection, repeats: int = USUAL_REPEATS) -> Iterator[str]:
    """Lines of Markdown: every case, the calibration, and the seconds of whole commands."""
    selection = replace(selection, how=replace(selection.how, tolerance=ASKED))
    cases = selection.cases(spp=SPP)
    yield f"Sphere, 3 views of 128², {SPP} samples a pixel; {selection.how}, {selection.jobs} fits at a time."
    yield "Promised: how far any determined number may still move; true: the largest relative error of those numbers."
    yield ""
    yield "| environment | metal | alpha | promised | of | true | of | promised / true | reached | efforts | s |"
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    outcomes = []
    for outcome in outcomes_of(cases, variant, selection):
        outcomes.append(outcome)
        yield case_row(outcome)
    yield ""
    yield from summary(outcomes)
    yield ""
    yield from commands([case.scene(variant) for case in one_for_each_alpha(selection)], repeats)


def outcomes_of(cases: Sequence[Case], variant: str, selection: Selection) -> Iterator[Outcome]:
    """Every case, in order; photographs come first."""
    scenes = [case.scene(variant) for case in cases]
    results = in_processes(partial(attempt, how=selection.how), scenes, selection.jobs)
    for case, result in zip(cases, results, strict=True):
        yield Outcome(case, result)


def case_row(outcome: Outcome) -> str:
    """One case, as a row of the table."""
    case, worst, pair = outcome.case, outcome.worst, outcome.pair
    promised = ("–", "–") if outcome.promised is None else (f"{outcome.promised:.2%}", outcome.rungs[-1].of)
    true = ("–", "–") if worst is None else (f"{worst[1]:.2%}", worst[0])
    ratio = "–" if pair is None else f"{_ratio(pair):.2f}"
    reached = outcome.result if isinstance(outcome.result, str) else "yes" if outcome.reached else "no"
    efforts = ", ".join(f"{rung.pixels} × {rung.samples} × {rung.levels}" for rung in outcome.rungs)
    cells = (case.environment, case.metal, f"{case.alpha:g}", *promised, *true, ratio, reached, efforts)
    return f"| {' | '.join(map(str, cells))} | {outcome.seconds:.1f} |"


def summary(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """The calibration over all cases."""
    judged = [(outcome.case.label, outcome.pair) for outcome in outcomes if outcome.pair is not None]
    if judged:
        kept = np.array([true <= promised for _, (promised, true) in judged])
        over = statistics.median(_ratio(pair) for _, pair in judged)
        yield f"- true ≤ promised: {share(kept)} of {len(judged)} cases (goal {KEPT_GOAL:.0%})"
        yield f"- promised / true: {over:.2f} in the median (goal at most {PESSIMISM_GOAL})"
        broken = [f"{label} × {true / promised:.2f}" for label, (promised, true) in judged if true > promised]
        yield f"- true over promised where that is above 1: {', '.join(broken) or 'nowhere'}"
    yield f"- reached {ASKED:.0%}: {share(np.array([outcome.reached for outcome in outcomes]))}"
    silent = [outcome.case.label for outcome in outcomes if outcome.pair is None]
    yield f"- nothing promised, or no result: {', '.join(silent) or 'nowhere'}"
    seconds = [outcome.seconds for outcome in outcomes if not math.isnan(outcome.seconds)]
    if seconds:
        late = np.percentile(seconds, 90, method="higher")
        yield f"- seconds in process: {statistics.median(seconds):.2f} in the median, 90th percentile {late:.2f}"


def _ratio(pair: tuple[float, float]) -> float:
    promised, true = pair
    return promised / true if true else math.inf


def one_for_each_alpha(selection: Selection) -> list[Case]:
    """As many cases as there are roughnesses, metals and environments changing along with them."""
    metals, environments = selection.metals, selection.environments
    return [
        Case(metals[i % len(metals)], alpha, environments[i % len(environments)], spp=SPP)
        for i, alpha in enumerate(selection.alphas)
    ]


def commands(scenes: Sequence[Path], repeats: int) -> Iterator[str]:
    """Wall and CPU seconds of whole commands, each a process of its own, all in turn."""
    taken: dict[tuple[Path, str], list[Ended]] = {(scene, name): [] for scene in scenes for name in COMMANDS}
    for _ in range(repeats):
        for scene, name in taken:
            taken[scene, name].append(_command(scene, COMMANDS[name]))
    yield f"`fit-material fit SCENE -o DIR -q …`, start-up included; {repeats} repeats in turn: median (range)."
    yield ""
    yield "| scene | … | s | CPU s |"
    yield "|---|---|---|---|"
    for (scene, name), runs in taken.items():
        wall, cpu = (spread([getattr(run, key) for run in runs]) for key in ("seconds", "cpu"))
        yield f"| {scene.parent.name} | `{name}` | {wall} | {cpu} |"
    yield ""
    for name, goal in COMMAND_GOALS.items():
        medians = [statistics.median(run.seconds for run in taken[scene, name]) for scene in scenes]
        yield f"- `{name}`: {spread(medians)} s over the scenes' medians (goal: median {goal:g} s)"


def _command(scene: Path, options: Sequence[str]) -> Ended:
    """Raises RuntimeError where the command did not come to a result: its seconds would mean nothing."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "fit_material", "fit", str(scene), "-o", f"{folder}/out", "--quiet", *options]
        ended = frontier_runs.measured(command, Path(folder) / "errors.txt")
    if ended.code not in (0, 1):
        raise RuntimeError(f"{scene.parent.name} {' '.join(options)}: code {ended.code}, {ended.last_words}")
    return ended
