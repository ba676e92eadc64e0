"""What a process of a batch does: one fit after another, each into a folder of its own."""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from fit_material.fitter.batch.workers.record import RECORD, key_of, replaceable_by_batch, write_record
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.renderer.compute.threads import limit_cores
from fit_material.renderer.errors.input_error import InputError

# of C++, torch, abseil and the dynamic linker, none of which raises a MemoryError
NO_MEMORY = ("bad_alloc", "allocate memory", "mmap error", "failed to map segment")
NO_THREAD = "can't start new thread"  # Python's, for want of memory for its stack or by a limit of processes


@dataclass(frozen=True)
class Task:
    """One fit.

    Attributes:
        name: of its result.
        scene: file, absolute.
        options: how to fit.
        key: of the options by the code of the process that sent the task.
        folder: that every fit of this batch has a place in; when it goes, no process waits for them any more.
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
        reason: why it was not fitted, a sentence.
        worker: where.
        starts: how many times it was started.
    """

    name: str
    how: Literal["fitted", "refused", "failed"]
    reason: str = ""
    folder: Path | None = None
    worker: str = ""
    starts: int = 1


class _Abandoned(Exception):
    """Nobody waits for this fit any more."""


def fit_one(task: Task, worker: str) -> Ended:
    """Fit a scene into a new folder inside the task's; an error is returned, nothing is raised.

    Args:
        worker: what this process is called.
    """

    def ended(how: Literal["refused", "failed"], reason: str) -> Ended:
        return Ended(task.name, how, reason, worker=worker, starts=starts)

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
        return ended("failed", _sentence(error))
    return Ended(task.name, "fitted", folder=folder, worker=worker, starts=starts)


def _fit(task: Task, folder: Path) -> None:
    started = time.perf_counter()
    if task.cores is not None:
        limit_cores(task.cores)
    from fit_material.fitter.pipeline.fit_scene import fit_scene

    def progress(stage: str, share: float) -> None:
        if not task.folder.exists():
            raise _Abandoned

    target = task.folder.parent / task.name
    replaceable_by_batch(target, [task.scene]).require(target, [RECORD])
    fit_scene(task.scene, folder, replace(task.options, command=task.command), progress, started, target=target)


def _sentence(error: Exception) -> str:
    """What went wrong, on one line."""
    reason = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, MemoryError) or is_about_memory(reason):
        return f"not enough memory for this fit ({reason})"
    if NO_THREAD in reason:
        return f"not enough memory, or too many processes, for this fit ({reason})"
    return f"internal error: {reason}"


def is_about_memory(text: str) -> bool:
    """Whether a library reports there that it got none."""
    return any(words in text for words in NO_MEMORY)
