"""Ours against Mitsuba's own inverse rendering: a gold ball under a studio map, the same photographs, this machine."""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from fit_material.fitter.estimation.coarse_to_fine import Problem, rounds
from fit_material.fitter.forward.lighting import lighting_for
from fit_material.fitter.least_squares.solvers import SOLVERS, compiling
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import choose_pixels
from fit_material.fitter.observations.scene_data import Loaded, load
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.fitter.result.schema import FittedMaterial, read_result
from fit_material.renderer.compute.threads import one_thread_per_operation
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueMetal
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.synthesis.synthesise import SynthOptions
from fit_material.shaders.materials.types import Metal
from tests.bench.mitsuba_inverse import State, gauss_newton, gauss_newton_in_one_pass, tuned, tutorial
from tests.bench.photographs import map_of, photographed, truth_of
from tests.bench.setting import header, spread

NEAR = 0.01  # relative, of alpha and of every channel's F0
RIVALS: dict[str, tuple[str, Callable[[Loaded, float], Iterator[State]]]] = {
    "a": ("Adam as in the tutorials: raw eta, k, alpha; `prb`, full size, 16 samples", tutorial),
    "b": ("Adam tuned with the truth known: logarithms, `direct`, 64², scheduled", tuned),
    "c": ("Gauss–Newton on forward derivatives, 32², 1024 samples", gauss_newton),
    "d": ("the same by our own derivatives of Mitsuba's paths, one pass for all", gauss_newton_in_one_pass),
}
LIMITS = {"a": {1: 90.0, 3: 230.0}, "b": {1: 60.0, 3: 90.0}, "c": {1: 30.0, 3: 60.0}, "d": {1: 30.0, 3: 30.0}}
COMMANDS = ("--type metal --fidelity preview", "--type metal", "--type auto")
REPEATS = {"ours": 5, "a": 1, "b": 3, "c": 3, "d": 3}


@dataclass(frozen=True)
class Course:
    """How to race.

    Attributes:
        views: numbers of photographs, each a race of its own.
        size, spp: of the photographs.
        limit: seconds that no rival may exceed; None for `LIMITS`.
        repeats: of ours; None for `REPEATS`, which goes for all.
    """

    views: Sequence[int] = (1, 3)
    size: int = 256
    spp: int = 1024
    limit: float | None = None
    repeats: int | None = None

    def limit_of(self, rival: str, views: int) -> float:
        usual = LIMITS[rival].get(views, 90.0)
        return usual if self.limit is None else min(usual, self.limit)

    def repeats_of(self, who: str) -> int:
        return REPEATS[who] if self.repeats is None else min(REPEATS[who], self.repeats)


@dataclass(frozen=True)
class Truth:
    """What was photographed."""

    n: Float[np.ndarray, " 3"]
    k: Float[np.ndarray, " 3"]
    f0: Float[np.ndarray, " 3"]
    alpha: float

    @staticmethod
    def of(scene: Path) -> Truth:
        told = truth_of(scene)
        return Truth(*(np.array(told[key]) for key in ("n", "k", "f0")), told["alpha"])

    def is_near(self, state: State) -> bool:
        """Whether alpha and F0 of every channel are within `NEAR`."""
        off = [*(state.f0 / self.f0 - 1), state.alpha / self.alpha - 1]
        return bool(np.abs(off).max() <= NEAR)

    def errors(self, state: State) -> str:
        """Relative errors of n and k, red, green, blue."""
        pairs = (("n", state.n / self.n - 1), ("k", state.k / self.k - 1))
        return ", ".join(f"{key} " + " ".join(f"{each:+.1%}" for each in off) for key, off in pairs)


@dataclass(frozen=True)
class Finish:
    """One run.

    Attributes:
        first: seconds until it was near; infinite where it never was.
        stays: seconds from which on it was near to the end.
        last: where it was in the end.
    """

    first: float
    stays: float
    last: State

    @staticmethod
    def of(states: Sequence[State], truth: Truth) -> Finish:
        near = [truth.is_near(state) for state in states]
        seconds = [state.seconds for state in states]
        first = next((at for at, there in zip(seconds, near, strict=True) if there), float("inf"))
        away = max((i for i, there in enumerate(near) if not there), default=-1)
        stays = seconds[away + 1] if away + 1 < len(states) else float("inf")
        return Finish(first, stays, states[-1])


def rows(variant: str, course: Course = Course()) -> Iterator[str]:
    """Lines of a Markdown table for each number of views."""
    yield f"Gold ball, alpha 0.2, studio_small_03, {course.size}², {course.spp} samples ({variant}); in process after"
    yield f"loading, seconds until alpha and F0 of every channel are within {NEAR:.0%} of the truth, median (range)."
    yield "All know that it is a metal, and compile in a step that is not counted. Ours begins with choosing pixels and"
    yield "is looked at after each round, as rivals after each step; then the whole of `fit_scene` (reading, rounds,"
    yield "errors, report), and the command. `never` is within the rival's limit."
    for views in course.views:
        scene = photographed(_options(course, views, variant), "gold-256")
        yield ""
        yield f"{views} view{'s' * (views > 1)}:"
        yield ""
        yield "| who | near | stays near | over ours | relative errors in the end, R G B |"
        yield "|---|---|---|---|---|"
        yield from _table(scene, views, course)


def _options(course: Course, views: int, variant: str) -> SynthOptions:
    gold = metal("Au")
    material = TrueMetal(gold.n, gold.k, 0.2, metal=gold.name, source=gold.source)
    env = map_of("studio_small_03")
    return SynthOptions(material, env=env, size=course.size, spp=course.spp, views=views, variant=variant)


def _table(scene: Path, views: int, course: Course) -> Iterator[str]:
    truth, repeats = Truth.of(scene), course.repeats_of("ours")
    loaded = load(scene)
    compiling().result()
    rounds_of = [Finish.of(list(_rounds(loaded, scene)), truth) for _ in range(1 + repeats)][1:]  # the first compiles
    usual = statistics.median(each.first for each in rounds_of)
    yield _row("ours, by rounds", rounds_of, usual, truth)
    last = [each.last.seconds for each in rounds_of]
    yield f"| … its last round, whose errors these are | {spread(last)} | | {statistics.median(last) / usual:.3g} | |"
    for kind in ("metal", "auto"):
        finishes = [_ours(scene, kind, truth) for _ in range(repeats)]
        yield _row(f"ours, the whole of `fit_scene`, `--type {kind}`", finishes, usual, truth)
    for options in COMMANDS:
        whole = [_command(scene, truth, options) for _ in range(repeats)]
        yield _row(f"ours, the whole command `fit {options}`, start-up included", whole, usual, truth)
    for rival, (name, run) in RIVALS.items():
        limit = course.limit_of(rival, views)
        next(run(loaded, 0.0))  # compiles
        runs = [list(run(loaded, limit)) for _ in range(course.repeats_of(rival))]
        yield _row(f"({rival}) {name}; limit {limit:g} s", [Finish.of(each, truth) for each in runs], usual, truth)


def _rounds(loaded: Loaded, scene: Path) -> Iterator[State]:
    """Ours, from choosing pixels on: the draft and what each round makes of it."""
    begun, options = time.perf_counter(), FitOptions(type="metal")
    lighting, trace = lighting_for(loaded, options, torch.device("cpu")), gbuffer.tracer(loaded.shape)
    count, footprint = lighting.fidelity.pixels, lighting.fidelity.footprint
    with one_thread_per_operation():
        (observed,) = choose_pixels(PixelRequest(loaded.photographs, trace, scene, footprint, options.seed), count)
        assert observed is not None
        problem = Problem(observed, lighting, SOLVERS[options.solver], lambda stage, share: None)
        for fit in rounds(problem, "metal"):
            found = fit.material
            assert isinstance(found, Metal)
            yield State(time.perf_counter() - begun, found.n.numpy(), found.k.numpy(), float(found.width.value))


def _ours(scene: Path, kind: str, truth: Truth) -> Finish:
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        found = fit_scene(scene, Path(folder), FitOptions(type=kind)).materials[0]
        return _finish(found, time.perf_counter() - begun, truth)


def _command(scene: Path, truth: Truth, options: str) -> Finish:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "fit_material", "fit", str(scene), "-o", folder, "--quiet", *options.split()]
        begun = time.perf_counter()
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        seconds = time.perf_counter() - begun
        return _finish(read_result(Path(folder) / "result.json").materials[0], seconds, truth)


def _finish(found: FittedMaterial, seconds: float, truth: Truth) -> Finish:
    n, k = (np.array(numbers or [np.nan] * 3) for numbers in (found.n, found.k))
    return Finish.of([State(seconds, n, k, found.alpha or 0.0)], truth)


def _row(who: str, finishes: Sequence[Finish], ours: float, truth: Truth) -> str:
    first, stays = ([getattr(each, key) for each in finishes] for key in ("first", "stays"))
    over = statistics.median(first) / ours
    return f"| {who} | {_seconds(first)} | {_seconds(stays)} | {over:.3g} | {truth.errors(finishes[-1].last)} |"


def _seconds(values: Sequence[float]) -> str:
    """Median and range; `never` where the median run was not near."""
    if np.isinf(statistics.median(values)):
        return "never" if len(values) == 1 else f"never ({sum(np.isinf(values))} of {len(values)})"
    return spread(values)


def main() -> None:
    """The race alone, with limits of one's own."""
    from fit_material.renderer.mitsuba.conversion import variant_here

    parser = argparse.ArgumentParser("python -m tests.bench.race", description=__doc__)
    parser.add_argument("--views", type=int, nargs="+", default=Course.views)
    parser.add_argument("--limit", type=float, help="seconds that no rival may exceed")
    parser.add_argument("--repeats", type=int, help="at most so many runs of each")
    asked = parser.parse_args()
    print(header(), flush=True)
    for row in rows(variant_here(), Course(asked.views, limit=asked.limit, repeats=asked.repeats)):
        print(row, flush=True)


if __name__ == "__main__":
    main()
