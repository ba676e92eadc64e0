"""What accuracy costs in time: the ladder on four materials in three lights, as a page of the repository."""

from __future__ import annotations

import functools
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from fit_material.fitter.frontier.errors import Reference, truth_beside
from fit_material.fitter.frontier.pareto import Frontier, frontier_of
from fit_material.fitter.frontier.rungs import LADDER, Rung
from fit_material.fitter.frontier.runs import Experiment, Run, all_runs
from fit_material.fitter.observations.scene_data import input_files
from fit_material.fitter.result.provenance import code_digest
from fit_material.renderer.files.atomic import write_bytes_atomically, write_text_atomically
from fit_material.renderer.scene.scene_file import read_scene
from tests.bench import types
from tests.bench.accuracy_advice import advice
from tests.bench.accuracy_plot import accuracy_png
from tests.bench.accuracy_table import knee_sentence, medians_table
from tests.bench.photographs import ENVIRONMENTS, Case
from tests.bench.setting import CACHE, header

SPP = 1024
USUAL_REPEATS = 1
NAME = "accuracy"


def _ball(symbol: str, alpha: float) -> Callable[[str, str], Path]:
    return lambda environment, variant: Case(symbol, alpha, environment, spp=SPP).scene(variant)


def _plastic(environment: str, variant: str) -> Path:
    return types.scene_of("red plastic", variant, SPP, environment)


MATERIALS: Mapping[str, tuple[str, Callable[[str, str], Path]]] = {
    "gold": ("gold, alpha 0.1", _ball("Au", 0.1)),
    "aluminium": ("aluminium, alpha 0.2", _ball("Al", 0.2)),
    "iron": ("iron, alpha 0.4", _ball("Fe", 0.4)),
    "plastic": ("red plastic, alpha 0.1", _plastic),
}
"""Of each what it is called, and from environment and Mitsuba's variant to the scene file."""


@dataclass(frozen=True)
class Extent:
    """How much of it is to be measured.

    Attributes:
        materials, environments: keys of `MATERIALS`; of `photographs.ENVIRONMENTS`.
        rungs: of the ladder.
        repeats: of each rung in each case.
    """

    materials: Sequence[str] = tuple(MATERIALS)
    environments: Sequence[str] = ENVIRONMENTS
    rungs: Sequence[Rung] = LADDER
    repeats: int = USUAL_REPEATS


@dataclass(frozen=True)
class Compared:
    """The ladder on one material in one light.

    Attributes:
        runs: of all rungs.
        truth: what was photographed.
    """

    material: str
    environment: str
    frontier: Frontier
    runs: Sequence[Run]
    truth: Sequence[Reference]


def rows(variant: str, extent: Extent, out: Path) -> Iterator[str]:
    """A line for each case, then the page, which is written as `accuracy.md` beside `accuracy.png`."""
    begun, found = header(), []
    for material, environment in product(extent.materials, extent.environments):
        found.append(_compared(material, environment, variant, extent))
        yield f"- {found[-1].material}, {environment}: knee {found[-1].frontier.knee or 'none'}"
    page = page_text(found, begun, shlex.join(["python", "-m", "tests.bench", *sys.argv[1:]]))
    out.mkdir(parents=True, exist_ok=True)
    write_bytes_atomically(out / f"{NAME}.png", accuracy_png([(c.material, c.environment, c.frontier) for c in found]))
    write_text_atomically(out / f"{NAME}.md", page)
    yield ""
    yield page


def _compared(material: str, environment: str, variant: str, extent: Extent) -> Compared:
    """Runs are kept for this code and these photographs: what was interrupted goes on where it was."""
    title, photographed = MATERIALS[material]
    scene = photographed(environment, variant)
    truth = truth_beside(scene)
    assert truth is not None
    folder = CACHE / "frontier" / code_digest() / scene.parent.name
    folder.mkdir(parents=True, exist_ok=True)
    experiment = Experiment(scene, input_files(read_scene(scene), scene), (), folder)
    told = functools.partial(_tell, f"{title}, {environment}")
    runs = all_runs(experiment, extent.rungs, extent.repeats, told)
    return Compared(title, environment, frontier_of(scene.parent.name, extent.rungs, runs, truth), runs, truth)


def _tell(case: str, what: str, share: float) -> None:
    print(f"{case}: {share:.0%} of {what}", file=sys.stderr, flush=True)


def page_text(found: Sequence[Compared], measured: str, command: str) -> str:
    """The page, from measured data and nothing else.

    Args:
        found: all cases, of the same rungs.
        measured: commit, machine and versions.
        command: that made it.
    """
    frontiers = [each.frontier for each in found]
    materials, environments = (
        dict.fromkeys(getattr(each, key) for each in found) for key in ("material", "environment")
    )
    lines = [
        "# What accuracy costs in time",
        "",
        f"Made by `{command}` from measured data only; do not edit.",
        "",
        *measured.strip().splitlines(),
        "",
        f"Balls of {'; '.join(materials)}, each under {', '.join(environments)}: three photographs of 128² by Mitsuba,"
        f" {SPP} samples a pixel. Every point is the whole `fit` command, a process of its own, told nothing but the"
        " rung; the error is the largest of n, k, F0, alpha and colour against the truth.",
        "",
        f"![Seconds against error, a plot for each material and environment]({NAME}.png)",
        "",
        "Lines join the rungs that none beats in both; hollow are those that another beats; the knee is ringed.",
        "",
        *medians_table(frontiers),
        "",
        knee_sentence(frontiers),
        "",
        "## Advice",
        "",
        *advice(frontiers, [(each.runs, each.truth) for each in found]),
    ]
    return "\n".join(lines) + "\n"
