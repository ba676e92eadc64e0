"""Which of the three types is found without being told, and how well its numbers are: four materials of each."""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fit_material.fitter.options.fidelity import preset
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.fitter.result.schema import FittedMaterial, Result
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueGlossy, TrueMaterial, TrueMatte, TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions
from tests.bench.photographs import map_of, photographed, truth_of
from tests.bench.setting import spread

KEYS = ("color", "f0", "alpha")
GOALS = {"color": 0.01, "f0": 0.005, "f0 of metals": 0.01, "alpha": 0.05}
_RUNNER_UP = re.compile(r"(\w+) comes next, its information criterion \(BIC\) is worse by (\d+(?:\.\d+)?(?:e[-+]\d+)?)")


def _metal(name: str, alpha: float) -> TrueMetal:
    known = metal(name)
    return TrueMetal(known.n, known.k, alpha, metal=known.name, source=known.source)


def _glossy(color: tuple[float, float, float], f0: float, alpha: float) -> TrueGlossy:
    return TrueGlossy(color, (f0, f0, f0), alpha)


MATERIALS: dict[str, TrueMaterial] = {
    "gold": _metal("Au", 0.2),
    "copper": _metal("Cu", 0.1),
    "aluminium": _metal("Al", 0.3),
    "iron": _metal("Fe", 0.4),
    "red plastic": _glossy((0.6, 0.1, 0.05), 0.04, 0.1),
    "blue lacquer": _glossy((0.05, 0.15, 0.5), 0.06, 0.05),
    "grey plastic": _glossy((0.3, 0.3, 0.3), 0.03, 0.4),
    "cream glaze": _glossy((0.85, 0.8, 0.65), 0.08, 0.2),
    "clay": TrueMatte((0.5, 0.3, 0.2)),
    "moss": TrueMatte((0.15, 0.4, 0.1)),
    "soot": TrueMatte((0.02, 0.02, 0.025)),
    "plaster": TrueMatte((0.95, 0.94, 0.92)),
}


@dataclass(frozen=True)
class Outcome:
    """One fit that was told nothing, and the truth."""

    name: str
    result: Result
    truth: dict
    seconds: float

    @property
    def found(self) -> FittedMaterial:
        """The only material."""
        return self.result.materials[0]

    @property
    def is_right(self) -> bool:
        """Whether the type is the true one."""
        return self.found.type == self.truth["type"]

    @property
    def runner_up(self) -> str:
        """The next best type, and by how much its criterion is worse, as the message says."""
        told = _RUNNER_UP.search(self.result.message)
        return f"{told[1]} +{float(told[2]):.4g}" if told else "–"

    def error(self, key: str) -> float | None:
        """Largest over the channels: absolute, but of alpha relative; None where the material has no such number."""
        pair = self._pair(key)
        if pair is None:
            return None
        found, true = pair
        return float(np.abs(found - true).max() / (true.max() if key == "alpha" else 1))

    def deviations(self, key: str) -> float | None:
        """Largest error over the channels, in stated standard errors."""
        pair, stated = self._pair(key), getattr(self.found.stderr, key)
        if pair is None or stated is None or None in np.atleast_1d(stated):
            return None
        found, true = pair
        return float((np.abs(found - true) / np.maximum(np.atleast_1d(stated), 1e-12)).max())

    def _pair(self, key: str) -> tuple[np.ndarray, np.ndarray] | None:
        found, true = getattr(self.found, key), self.truth[key]
        return None if found is None or true is None else (np.atleast_1d(found), np.atleast_1d(true))


def rows(variant: str, spp: int = 1024) -> Iterator[str]:
    """Lines of a Markdown table, and what is farthest from the goals."""
    yield f"Sphere in studio_small_03, three views of 128², {spp} samples a pixel; --type auto, standard fidelity."
    yield ""
    yield "| material | true | found | next, BIC | color | F0 | alpha | rms | s |"
    yield "|---|---|---|---|---|---|---|---|---|"
    outcomes = []
    for name in MATERIALS:
        outcomes.append(_outcome(name, variant, spp))
        yield _row(outcomes[-1])
    yield ""
    yield from _extremes(outcomes)


def scene_of(name: str, variant: str, spp: int = 1024, environment: str = "studio_small_03") -> Path:
    """The scene file of photographs of one of `MATERIALS`."""
    options = SynthOptions(MATERIALS[name], env=map_of(environment), size=128, spp=spp, variant=variant)
    return photographed(options, f"types-{name.replace(' ', '-')}")


def _outcome(name: str, variant: str, spp: int) -> Outcome:
    scene = scene_of(name, variant, spp)
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        result = fit_scene(scene, Path(folder), FitOptions(preset("standard")))
        return Outcome(name, result, truth_of(scene), time.perf_counter() - begun)


def _row(outcome: Outcome) -> str:
    found, truth = outcome.found, outcome.truth
    numbers = " | ".join(_compared(truth[key], getattr(found, key), getattr(found.stderr, key)) for key in KEYS)
    rms = outcome.result.quality.overall.rms_relative or 0
    types = f"{truth['type']} | {found.type}, {outcome.result.status} | {outcome.runner_up}"
    return f"| {outcome.name} | {types} | {numbers} | {rms:.2%} | {outcome.seconds:.1f} |"


def _compared(true: object, found: object, errors: object) -> str:
    """The true number, what was found, and its stated standard error; channels one after another."""
    if true is None and found is None:
        return ""
    return f"{_numbers(true)} → {_numbers(found)} ± {_numbers(errors, '.1e')}"


def _numbers(values: object, form: str = ".4f") -> str:
    each = values if isinstance(values, Sequence) else (values,)
    return " ".join("?" if value is None else format(value, form) for value in each)


def _extremes(outcomes: Sequence[Outcome]) -> Iterator[str]:
    yield f"- right types: {sum(each.is_right for each in outcomes)} of {len(outcomes)}"
    groups = {key: [each for each in outcomes if (each.truth["type"] == "metal") <= (key != "f0")] for key in KEYS}
    groups["f0 of metals"] = [each for each in outcomes if each.truth["type"] == "metal"]
    for title, goal in GOALS.items():
        key = title.split()[0]
        errors = {each.name: error for each in groups[title] if (error := each.error(key)) is not None}
        stated = [deviations for each in groups[title] if (deviations := each.deviations(key)) is not None]
        worst = max(errors, key=errors.__getitem__)
        yield (
            f"- error of {title}, largest channel: {spread([*errors.values()])}, of {worst} (goal {goal:g});"
            f" {spread(stated)} stated standard errors"
        )
    yield f"- wall time: {spread([each.seconds for each in outcomes])} s"
