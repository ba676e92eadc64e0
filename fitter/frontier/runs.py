"""Fits as processes of their own, each kept as a small file, so that what was interrupted goes on where it was."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from fit_material.fitter.frontier.rungs import Rung
from fit_material.fitter.result.provenance import code_digest, versions
from fit_material.fitter.result.schema import FittedMaterial, InputFile, NonNegative, Record, Result, Time, read_result
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import write_text_atomically
from fit_material.renderer.files.regular_files import read_bytes, read_text
from fit_material.renderer.files.unfinished import unfinished_folder
from fit_material.renderer.files.validation import check

FORMAT = 1
KIBIBYTE = 1 if sys.platform == "darwin" else 1024  # ru_maxrss counts bytes there, and kibibytes elsewhere


class Run(Record):
    """One fit.

    Attributes:
        rung, options, seed: what was run.
        status: of its result; "failed" where it left none.
        message: the result's, or the failed process's last words.
        command: wall-clock seconds of the whole process, the start of Python included.
        time: the result's stages.
        cpu: seconds of all cores together, which a busy machine hardly changes; None where it was not measured.
        peak: most memory that the process held, bytes.
        materials: found.
        picture: rms of fit less photographs over the photographs'.
    """

    format: Literal[1] = FORMAT
    rung: str
    options: tuple[str, ...]
    seed: int
    status: Literal["converged", "not_determined", "stopped", "failed"]
    message: str
    command: NonNegative
    peak: NonNegative
    cpu: NonNegative | None = None
    time: Time | None = None
    materials: tuple[FittedMaterial, ...] = ()
    picture: NonNegative | None = None


class Refused(InputError):
    """A fit's sentence about wrong input."""

    def __init__(self, sentence: str) -> None:
        Exception.__init__(self, sentence)
        self.file, self.field, self.value, self.expected = "", "", "", ""


@dataclass(frozen=True)
class Experiment:
    """A scene that is fitted again and again.

    Attributes:
        scene: scene file.
        inputs: all files that it names.
        options: of `fit`, the same for every run.
        folder: where runs are kept.
    """

    scene: Path
    inputs: tuple[InputFile, ...]
    options: tuple[str, ...]
    folder: Path

    def run(self, rung: Rung, seed: int) -> Run:
        """The run as it is kept, or made now; one that failed is not kept.

        A kept file that cannot be read counts for none, and is replaced: all that it held can be had again.

        Raises:
            InputError: the fit refuses its input.
        """
        kept = self.folder / f"{self._key(rung, seed)}.json"
        found = _read(kept)
        if found is not None:
            return found
        made = self._fresh(rung, seed)
        if made.status != "failed":
            text = json.dumps(made.model_dump(mode="json"), allow_nan=False, ensure_ascii=False, indent=1)
            write_text_atomically(kept, text + "\n")
        return made

    def _key(self, rung: Rung, seed: int) -> str:
        """What the run depends on: the files' contents, the options, the code, and the versions that compute."""
        contents = sorted(file.sha256 for file in self.inputs)
        told = [FORMAT, contents, *self.options, *rung.options, seed, code_digest(), versions()]
        return hashlib.sha256(json.dumps(told).encode()).hexdigest()[:16]

    def _fresh(self, rung: Rung, seed: int) -> Run:
        with unfinished_folder(self.folder) as out:
            options = ("--seed", str(seed), *self.options, *rung.options)
            arguments = ("fit", str(self.scene), "-o", str(out), "--quiet", *options)
            command = [sys.executable, "-P", "-m", "fit_material", *arguments]  # -P: no modules of the working folder
            ended = measured(command, out / "errors.txt")
            if ended.code == 2:
                raise Refused(ended.last_words.removeprefix("fit-material: "))
            found = out / "result.json"
            result = read_result(found) if ended.code in (0, 1) and found.exists() else None
        return _record(rung, seed, options, ended, result)


def _read(kept: Path) -> Run | None:
    """The run in that file; None where it is missing or damaged."""
    try:
        return check(Run, json.loads(read_text(kept, "utf-8")), kept)
    except (OSError, ValueError, RecursionError, InputError):
        return None


def _record(rung: Rung, seed: int, options: tuple[str, ...], ended: Ended, result: Result | None) -> Run:
    common = {"rung": rung.name, "options": options, "seed": seed, "command": ended.seconds}
    common |= {"peak": ended.peak, "cpu": ended.cpu}
    if result is None:
        told = f"ended with code {ended.code}: {ended.last_words}" if ended.last_words else f"code {ended.code}"
        return Run(status="failed", message=told, **common)
    return Run(
        status=result.status,
        message=result.message,
        time=result.time,
        materials=result.materials,
        picture=result.quality.overall.rms_relative,
        **common,
    )


@dataclass(frozen=True)
class Ended:
    """How a process ended: exit code (or -signal), last line of errors, wall and CPU seconds, peak bytes."""

    code: int
    last_words: str
    seconds: float
    cpu: float
    peak: int


def measured(command: Sequence[str], errors: Path) -> Ended:
    """Run a command to its end.

    Its peak memory is the kernel's count, `ru_maxrss`. That begins with what this process has held so far, less than
    any fit: both load torch, but a fit does not stop there.
    """
    with open(errors, "wb") as file:
        began = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=file)
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:  # Ctrl-C, above all: no process stays behind
            process.kill()
            process.wait()
            raise
        seconds = time.perf_counter() - began
        process.returncode = os.waitstatus_to_exitcode(status)
    lines = read_bytes(errors).decode("utf-8", "replace").strip().splitlines()
    cpu = usage.ru_utime + usage.ru_stime
    return Ended(process.returncode, lines[-1] if lines else "", seconds, cpu, usage.ru_maxrss * KIBIBYTE)


def all_runs(
    experiment: Experiment, rungs: Sequence[Rung], repeats: int, progress: Callable[[str, float], None]
) -> list[Run]:
    """Every rung with the seeds from 0 on; each seed goes through all rungs, so that these meet the same machine."""
    count, runs = len(rungs) * repeats, []
    for seed in range(repeats):
        for rung in rungs:
            progress(f"{count} fits", len(runs) / count)
            runs.append(experiment.run(rung, seed))
    return runs
