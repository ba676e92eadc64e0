"""Fits by today's code, kept outside the tree so that a benchmark can go on where it was stopped."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from fit_material.fitter.options.fidelity import preset
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.fitter.result.provenance import code_digest
from fit_material.fitter.result.schema import Result, read_result
from fit_material.renderer.files.atomic import write_bytes_atomically
from tests.bench.setting import CACHE

Item = TypeVar("Item")
Made = TypeVar("Made")


@dataclass(frozen=True)
class How:
    """What a fit is told: as a user would by default, if not otherwise."""

    type: str = "auto"
    fidelity: str = "standard"
    tolerance: float | None = None
    refine_pose: bool = False

    @property
    def label(self) -> str:
        """For the names of files."""
        also = ("" if self.tolerance is None else f"-{self.tolerance:g}") + ("-posed" if self.refine_pose else "")
        return f"{self.type}-{self.fidelity}{also}"

    def options(self, seed: int = 0) -> FitOptions:
        """As `fit_scene` takes them."""
        told = {"type": self.type, "tolerance": self.tolerance, "refine_pose": self.refine_pose}
        return FitOptions(preset(self.fidelity), seed=seed, **told)


def result_of(scene: Path, how: How) -> Result:
    """The result of a scene; fitted where the same code has not done so before."""
    kept = CACHE / "fits" / code_digest() / f"{scene.parent.name}-{how.label}.json"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as folder:
            fit_scene(scene, Path(folder), how.options())
            write_bytes_atomically(kept, (Path(folder) / "result.json").read_bytes())
    return read_result(kept)


def attempt(scene: Path, how: How) -> Result | str:
    """The same, or what went wrong: one case that cannot be fitted must not cost the figures of all others."""
    try:
        return result_of(scene, how)
    except Exception as error:
        return " ".join(f"{type(error).__name__}: {error}".split())


def attempt_anew(scene: Path, how: How, seed: int = 0) -> Result | str:
    """The same without a look at what is kept, for photographs that are made for one fit."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            return fit_scene(scene, Path(folder), how.options(seed))
    except Exception as error:
        return " ".join(f"{type(error).__name__}: {error}".split())


def in_processes(work: Callable[[Item], Made], items: Iterable[Item], jobs: int) -> Iterator[Made]:
    """`map`, by so many processes at a time; in this one where they are 1."""
    if jobs == 1:
        yield from map(work, items)
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(work, items)
