"""Many scenes: those that have no result yet are fitted by a crew of processes, and each result is taken over once."""

from __future__ import annotations

import fcntl
import os
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from fit_material.fitter.batch.fits_log import append_to_log, require_own_log
from fit_material.fitter.batch.summary import Scene, Summary, outcome, untouched
from fit_material.fitter.batch.workers.interrupts import interrupts_held
from fit_material.fitter.batch.workers.record import RECORD, Fitted, earlier, key_of, read_record, replaceable_by_batch
from fit_material.fitter.batch.workers.worker import Ended, Task
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.result.schema import Result, read_result
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import replaced_together
from fit_material.renderer.files.replaceable import Replaceable, json_with
from fit_material.renderer.files.unfinished import sweep, unfinished_folder

SUMMARY: tuple[str, ...] = ("summary.html", "summary.json")
SUMMARY_INTERVAL = 5.0  # seconds between two versions of the summary


@dataclass(frozen=True)
class Asked:
    """A scene of a batch, and how to fit it.

    Attributes:
        scene: file, absolute.
        options: of the fit.
        words: options that the list gives this scene alone.
    """

    scene: Path
    options: FitOptions
    words: tuple[str, ...]


@dataclass(frozen=True)
class Workers:
    """Who fits.

    Attributes:
        fits: makes tasks into their outcomes, as they end.
        cores: for each fit; None for as many as Dask's worker has threads.
        where: in words.
    """

    fits: Callable[[Sequence[Task]], Generator[Ended, None, None]]
    cores: int | None
    where: str


class Batch:
    """All scenes of a batch, by the names of their results, and the state of each.

    Attributes:
        scenes: to be fitted.
        out: folder of all results and of the summary.
        known: of every scene its state.
    """

    def __init__(self, scenes: Mapping[str, Asked], out: Path, command: str) -> None:
        self.scenes, self.out = scenes, Path(os.path.abspath(out))  # workers may be elsewhere
        self._started, self._command, self._written = time.perf_counter(), command, 0.0
        self._where = "nobody: all had been fitted before"
        self._keys = {name: key_of(asked.options) for name, asked in scenes.items()}
        self.known: dict[str, Scene] = {
            name: untouched(name, asked.scene, asked.words) for name, asked in scenes.items()
        }

    def look_up(self, progress: Progress) -> list[str]:
        """Take over what earlier batches have fitted; the names of the scenes still to fit."""
        left = []
        for number, (name, asked) in enumerate(self.scenes.items()):
            progress("looking for earlier results", number / len(self.scenes))
            found = earlier(self.out / name, asked.scene, self._keys[name])
            if found is None:
                left.append(name)
            else:
                self._note(name, *found, kept=True)
        return left

    def fit(self, names: list[str], crew: Workers, progress: Progress) -> None:
        """Fit those scenes and take their results over, each as soon as it is there."""
        done = 0
        self._where = crew.where
        with unfinished_folder(self.out) as folder:
            tasks = [self._task(name, folder, crew.cores) for name in names]
            progress(f"{len(names)} scenes", 0)
            with closing(crew.fits(tasks)) as outcomes:
                for ended in outcomes:
                    with interrupts_held():  # files that were moved are in the log and in the summary
                        self._take(ended)
                    done += 1
                    progress(f"{len(names)} scenes", done / len(names))
                    self._write_summary_now_and_then()

    def _task(self, name: str, folder: Path, cores: int | None) -> Task:
        asked = self.scenes[name]
        return Task(name, asked.scene, asked.options, self._keys[name], folder, self._command, cores)

    def _take(self, ended: Ended) -> None:
        """Make a fit's files the scene's result, which no other process does: none is there twice or in halves."""
        if ended.folder is None:
            state = "wrong_input" if ended.how == "refused" else "failed"
            found = {"status": state, "message": ended.reason, "worker": ended.worker, "starts": ended.starts}
            self.known[ended.name] = self.known[ended.name].model_copy(update=found)
            return
        target = self.out / ended.name
        try:
            with replaced_together(target, last=RECORD, replaceable=replaceable_by_batch(target)) as folder:
                for path in ended.folder.iterdir():
                    os.replace(path, folder / path.name)
        except InputError as error:  # about a file that has come there meanwhile, or a full disk
            self._take(Ended(ended.name, "failed", str(error), worker=ended.worker, starts=ended.starts))
            return
        record, result = read_record(target), read_result(target / "result.json")
        assert record is not None
        append_to_log(self.out, ended.name, record)
        self._note(ended.name, record, result, kept=False)

    def _note(self, name: str, record: Fitted, result: Result, kept: bool) -> None:
        self.known[name] = outcome(self.known[name], record, result, kept)

    @property
    def summary(self) -> Summary:
        """Of all scenes, as far as they are known."""
        seconds = time.perf_counter() - self._started
        return Summary(scenes=tuple(self.known.values()), seconds=seconds, where=self._where, command=self._command)

    def _write_summary_now_and_then(self) -> None:
        if time.perf_counter() > self._written + SUMMARY_INTERVAL:
            self.write_summary()
            self._written = time.perf_counter()

    def write_summary(self) -> None:
        """Of all scenes, as far as they are known, into `out`."""
        from fit_material.fitter.batch import page

        page.write_summary(self.summary, self.out)


@contextmanager
def alone_in(out: Path) -> Iterator[None]:
    """Make the folder of a batch, without what dead ones left unfinished; no other batch works there meanwhile.

    Raises:
        InputError: it is no folder that can be written, another batch works there, or files there are no batch's.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        handle = os.open(out, os.O_RDONLY)
        tempfile.TemporaryFile(dir=out).close()
    except OSError as error:
        raise InputError("-o", value=out, expected=f"a folder that can be written ({error.strerror})") from None
    try:
        _lock(handle, out)
        _require_own_summary(out)
        require_own_log(out)
        sweep(out)
        yield
    finally:
        os.close(handle)
        with suppress(OSError):  # it is not empty, but for a batch that was refused
            out.rmdir()


def _require_own_summary(out: Path) -> None:
    """Refuse a folder where somebody else's files have the summary's names."""
    ours = json_with(out / "summary.json", "scenes", "counts", "where") is not None
    own = dict.fromkeys(SUMMARY if ours else ())
    Replaceable(own=own, known="one of an earlier batch, beside its summary.json").require(out, SUMMARY)


def _lock(handle: int, out: Path) -> None:
    """The folder is this process's until the handle is closed, however it ends."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError("-o", value=out, expected="a folder that no other batch writes to at the same time") from None
    except OSError:  # a disk that has no locks
        return
