"""Who fits a batch on this machine: processes, of which those that die are started again."""

from __future__ import annotations

import sys
from collections import defaultdict, deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from multiprocessing.connection import Connection, wait

from fit_material.fitter.batch.workers.process import Process
from fit_material.fitter.batch.workers.worker import Ended, Task
from fit_material.renderer.compute.memory import memory_limit
from fit_material.renderer.compute.threads import cores

MAX_RESTARTS = 2  # of processes by one scene, after which it is not tried again; and of processes that only start
MEMORY = 2 * 2**30  # bytes for each process of this machine: a fit of the standard fidelity takes 1.2 to 1.6 GiB


class Lost(Exception):
    """No worker is left to fit the remaining scenes; a sentence."""


def usual_workers(scenes: int, each: int) -> int:
    """Processes of this machine, of so many cores each: no more than scenes, or than cores and memory serve."""
    return max(1, min(scenes, cores() // each, memory_limit() // MEMORY))


def local_fits(count: int, tasks: Sequence[Task]) -> Generator[Ended, None, None]:
    """All tasks, as they end, by so many processes of this machine.

    Raises:
        Lost: no process can be started.
    """
    with closing(_Crew(count, tasks)) as crew:
        while crew.is_busy:
            crew.hand_out()
            yield from crew.ended()
        printed = crew.close()
    if printed:
        print("\n".join(printed), file=sys.stderr, flush=True)


class _Crew:
    """Processes and tasks.

    No process has more than one task at a time: where it dies, one scene alone can have been the reason.
    """

    def __init__(self, count: int, tasks: Sequence[Task]) -> None:
        self._count, self._waiting = count, deque(tasks)
        self._processes: dict[Connection, Process] = {}
        self._deaths: dict[str, list[str]] = defaultdict(list)
        self._failed_starts: list[str] = []

    @property
    def _fitting(self) -> int:
        return sum(process.task is not None for process in self._processes.values())

    @property
    def is_busy(self) -> bool:
        """Whether tasks are left."""
        return bool(self._waiting) or self._fitting > 0

    def hand_out(self) -> None:
        """Start the processes that are missing, and give a task to each that has none.

        Raises:
            Lost: no process can be started.
        """
        wanted = min(self._count, len(self._waiting) + self._fitting)
        while len(self._processes) < wanted and len(self._failed_starts) <= MAX_RESTARTS:
            self._start()
        if not self._processes:
            raise Lost(f"the processes that fit cannot start: {self._failed_starts[-1]}")
        for process in self._processes.values():
            if self._waiting and process.ready and process.task is None:
                process.give(self._waiting.popleft())

    def _start(self) -> None:
        try:
            process = Process()
        except OSError as error:  # too many processes or files, or no memory
            self._failed_starts.append(str(error))
        else:
            self._processes[process.connection] = process

    def ended(self) -> Iterator[Ended]:
        """Tasks that have ended, after waiting for something to happen."""
        for connection in wait(list(self._processes)):
            assert isinstance(connection, Connection)
            try:
                ended = self._processes[connection].take()
            except EOFError:
                ended = self._outcome_after_death(self._processes.pop(connection))
            if ended is not None:
                yield ended

    def _outcome_after_death(self, process: Process) -> Ended | None:
        """Its task goes to another process, unless it has cost too many; a process that never got ready has none."""
        status, task = process.exit_status(), process.task
        process.kill()
        process.wait()
        if process.ready:
            self._failed_starts.clear()
        else:
            self._failed_starts.append(status)
        if task is None:
            return None
        statuses = self._deaths[task.name]
        statuses.append(status)
        if len(statuses) > MAX_RESTARTS:
            reason = f"the process that fitted it died each time, of {', then of '.join(dict.fromkeys(statuses))}"
            return Ended(task.name, "failed", f"{reason}; tried {len(statuses)} times", starts=len(statuses))
        self._waiting.append(task)
        return None

    def close(self) -> list[str]:
        """Kill all processes; the lines that they printed, each once."""
        processes = list(self._processes.values())
        self._processes.clear()
        for process in processes:
            process.kill()
        return list(dict.fromkeys(line for process in processes for line in process.wait()))
