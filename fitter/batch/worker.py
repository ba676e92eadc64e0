"""What a process of a batch does: one fit after another, each into a folder of its own."""

from __future__ import annotations

import os
import signal
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from fitter.batch.record import RECORD, key_of, replaceable_by_batch, write_record
from fitter.fit_options import FitOptions
from renderer.errors import InputError
from renderer.threads import limit_cores

_ONE_AT_A_TIME = threading.Lock()  # torch, JAX and Dr.Jit keep settings for a whole process


@dataclass(frozen=True)
class Task:
    """One fit.

    Attributes:
        name: of its result.
        scene: file, absolute.
        options: how to fit.
        key: of the options by the code of who asks.
        folder: that every fit of this batch has a place in; when it goes, nobody waits for them any more.
        command: the command line, for the report.
        cores: to compute on; None for as many as Dask's worker has threads.
    """

    name: str
    scene: Path
    options: FitOptions
    key: str
    folder: Path
    command: str
    cores: int | None = None


@dataclass(frozen=True)
class Ended:
    """How it ended.

    Attributes:
        how: "fitted", with all files in `folder`; "refused" as wrong input; "failed".
        told: why it was not fitted, a sentence.
        worker: where.
        starts: how many times it was begun.
    """

    name: str
    how: Literal["fitted", "refused", "failed"]
    told: str = ""
    folder: Path | None = None
    worker: str = ""
    starts: int = 1


class _Abandoned(Exception):
    """Nobody waits for this fit any more."""


def fit_one(task: Task) -> Ended:
    """Fit a scene into a new folder inside the task's; whatever goes wrong is told, nothing is raised."""
    from distributed import get_worker

    worker = get_worker()
    with _ONE_AT_A_TIME:
        limit_cores(task.cores or worker.state.nthreads)
        return _fitted(task, worker.address)


def _fitted(task: Task, worker: str) -> Ended:
    def ended(how: Literal["refused", "failed"], told: str) -> Ended:
        return Ended(task.name, how, told, worker=worker, starts=starts)

    starts = 1
    try:
        if not task.folder.is_dir():
            return ended("failed", f"{worker} does not see {task.folder.parent}: workers need the same files")
        if key_of(task.options) != task.key:
            return ended("failed", f"{worker} has another version of fit-material, or of what computes for it")
        place = task.folder / task.name
        place.mkdir(exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=f"{os.getpid()}-", dir=place))
        starts = sum(1 for _ in place.iterdir())
        _fit(task, folder)
        write_record(folder, task.scene, task.key, worker, starts)
    except InputError as error:
        return ended("refused", str(error))
    except Exception as error:
        return ended("failed", f"internal error: {' '.join(str(error).split()) or type(error).__name__}")
    return Ended(task.name, "fitted", folder=folder, worker=worker, starts=starts)


def _fit(task: Task, folder: Path) -> None:
    begun = time.perf_counter()
    from fitter.pipeline import fit_scene

    def progress(stage: str, share: float) -> None:
        if not task.folder.exists():
            raise _Abandoned

    target = task.folder.parent / task.name
    replaceable_by_batch(target, [task.scene]).require(target, [RECORD])
    fit_scene(task.scene, folder, replace(task.options, command=task.command), progress, begun, target=target)


def dask_setup(worker: Any) -> None:
    """Called by Dask in a process that this machine's batch begins: Ctrl-C is for the batch to hear; imports, early."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(Exception):  # the first fit meets it again, and tells it
        import_module("fitter.pipeline")
