"""Who fits a batch: processes of this machine, or the workers of a Dask cluster that runs already."""

from __future__ import annotations

import logging
import queue
import sys
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from fitter.batch.worker import Ended, Task, fit_one
from renderer.errors import InputError
from renderer.threads import cores

if TYPE_CHECKING:
    from distributed import Client, Future

DEATHS = 2  # of processes by one scene, after which it is not tried again
MEMORY = 2 * 2**30  # bytes for each process of this machine: a fit of the standard fidelity takes 1.2 to 1.6 GiB
PATIENCE = 10  # seconds until a scheduler has to answer


class Lost(Exception):
    """The scheduler is gone, or has dropped what it was asked for; a sentence."""


def usual_workers(scenes: int, each: int) -> int:
    """Processes of this machine, of so many cores each: no more than scenes, or than cores and memory serve."""
    from distributed.system import MEMORY_LIMIT  # a container's, where it has one

    return max(1, min(scenes, cores() // each, MEMORY_LIMIT // MEMORY))


@contextmanager
def local_crew(workers: int) -> Iterator[Client]:
    """So many processes of this machine, begun once; those that die are begun anew."""
    import dask.config
    from distributed import Client, LocalCluster

    _quiet()
    settings = {"distributed.scheduler.allowed-failures": DEATHS, "distributed.scheduler.worker-ttl": None}
    with tempfile.TemporaryDirectory(prefix="fit-material-") as folder, dask.config.set(settings):
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=0,  # as `fit`: the system's own
            dashboard_address=None,  # type: ignore[arg-type] — none, says its documentation
            silence_logs=logging.CRITICAL,
            local_directory=folder,
            preload=["fitter.batch.worker"],
        )
        with cluster, Client(cluster) as client:
            yield client


@contextmanager
def distant_crew(address: str) -> Iterator[Client]:
    """The workers of the scheduler at that address.

    Raises:
        InputError: none answers there.
    """
    from distributed import Client

    _quiet()
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:  # TimeoutError is an OSError
        reason = " ".join(str(error).split()) or type(error).__name__
        expected = f"the address of a Dask scheduler that runs, such as tcp://10.0.0.1:8786 ({reason})"
        raise InputError("--scheduler", value=address, expected=expected) from None
    with client:
        yield client


def _quiet() -> None:
    """Dask's log is about Dask; what matters here is told with the scene that it happened to."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)


def fits(client: Client, tasks: Sequence[Task]) -> Iterator[Ended]:
    """All tasks, as they end.

    No worker has more than one at a time: where its process dies, one scene alone can have been the reason.

    Raises:
        Lost: the scheduler does not answer any more.
    """
    ended: queue.SimpleQueue[Future] = queue.SimpleQueue()
    waiting = deque(tasks)
    running: dict[object, tuple[Future, Task]] = {}
    told = False
    try:
        while waiting or running:
            workers = _workers(client)
            if not workers and not told:
                told = True
                print("fit-material: the scheduler has no workers so far; waiting for one", file=sys.stderr, flush=True)
            while waiting and len(running) < max(workers, 1):
                task = waiting.popleft()
                future = client.submit(fit_one, task, key=f"fit-{task.folder.name}-{task.name}", pure=False)
                running[future.key] = future, task
                future.add_done_callback(ended.put)
            with suppress(queue.Empty):  # look anew how many workers there are
                future = ended.get(timeout=1)
                yield _outcome(*running.pop(future.key))
    finally:
        with suppress(Exception):  # a scheduler that is gone
            client.cancel([future for future, _ in running.values()], force=True)


def _workers(client: Client) -> int:
    """How many there are now."""
    try:
        return len(client.nthreads())  # type: ignore[arg-type] — a coroutine only of asynchronous clients
    except Exception as error:  # each way to lose it has its own
        raise Lost(f"the Dask scheduler is gone ({' '.join(str(error).split()) or type(error).__name__})") from error


def _outcome(future: Future, task: Task) -> Ended:
    from distributed import KilledWorker

    if future.cancelled():
        raise Lost("the Dask scheduler is gone, or somebody has cancelled the fits")
    try:
        return future.result()
    except KilledWorker:
        starts = len(list((task.folder / task.name).glob("*")))
        told = "the process that fitted it died each time (out of memory, perhaps)"
        return Ended(task.name, "failed", f"{told}; tried {starts} times", starts=starts)
    except Exception as error:  # Dask's own, or of a worker that has no fit-material
        return Ended(task.name, "failed", f"{type(error).__name__}: {' '.join(str(error).split())}")
    finally:
        future.release()
