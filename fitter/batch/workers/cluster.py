"""Who fits a batch elsewhere: the workers of a Dask cluster that runs already."""

from __future__ import annotations

import logging
import queue
import sys
import threading
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fit_material.fitter.batch.workers.pool import Lost
from fit_material.fitter.batch.workers.scheduler import EXAMPLE, Certificates, Scheduler
from fit_material.fitter.batch.workers.worker import Ended, Task, fit_one
from fit_material.renderer.errors.input_error import InputError

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_TIMEOUT = 10  # seconds until a scheduler has to answer

_ONE_AT_A_TIME = threading.Lock()  # torch, JAX and Dr.Jit keep settings for a whole process, and Dask's has threads


def cluster_fits(scheduler: Scheduler, tasks: Sequence[Task]) -> Generator[Ended, None, None]:
    """All tasks, as they end, by the workers of that scheduler.

    No worker has more than one at a time: where its process dies, one scene alone can have been the reason.

    Raises:
        InputError: no scheduler answers there.
        Lost: the scheduler does not answer any more.
    """
    with _client_of(scheduler) as client:
        yield from _fits(client, tasks)


@contextmanager
def _client_of(scheduler: Scheduler) -> Iterator[Client]:
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters here is in the scenes' outcomes
    try:
        client = Client(
            scheduler.address, timeout=CONNECT_TIMEOUT, set_as_default=False, **_security(scheduler.certificates)
        )
    except (OSError, ValueError, TypeError, RuntimeError) as error:  # TimeoutError is an OSError
        expected = f"the address of a Dask scheduler that runs, {EXAMPLE} ({_reason(error)})"
        raise InputError("--scheduler", value=scheduler.address, expected=expected) from None
    with client:
        yield client


def _security(files: Certificates | None) -> dict[str, Any]:
    """Arguments of Dask's client; where there are no certificates, what the user has set for Dask holds."""
    from distributed.security import Security

    if files is None:
        return {}
    key = None if files.key is None else str(files.key)
    own = Security(
        require_encryption=True, tls_ca_file=str(files.ca_file), tls_client_cert=str(files.cert), tls_client_key=key
    )
    return {"security": own}


def _reason(error: BaseException) -> str:
    """What an error came from: Dask wraps the errors of OpenSSL and of the system."""
    while error.__cause__ is not None:
        error = error.__cause__
    return " ".join(str(error).split()) or type(error).__name__


def _fits(client: Client, tasks: Sequence[Task]) -> Iterator[Ended]:
    ended: queue.SimpleQueue[Future] = queue.SimpleQueue()
    waiting = deque(tasks)
    running: dict[object, tuple[Future, Task]] = {}
    announced = False
    try:
        while waiting or running:
            workers = _workers(client)
            if not workers and not announced:
                announced = True
                print("fit-material: the scheduler has no workers so far; waiting for one", file=sys.stderr, flush=True)
            while waiting and len(running) < max(workers, 1):
                task = waiting.popleft()
                future = client.submit(fit_by_dask, task, key=f"fit-{task.folder.name}-{task.name}", pure=False)
                running[future.key] = future, task
                future.add_done_callback(ended.put)
            with suppress(queue.Empty):  # look anew how many workers there are
                future = ended.get(timeout=1)
                yield _outcome(*running.pop(future.key))
    finally:
        with suppress(Exception):  # a scheduler that is gone
            client.cancel([future for future, _ in running.values()], force=True)


def fit_by_dask(task: Task) -> Ended:
    """A fit in a worker of Dask."""
    from distributed import get_worker

    worker = get_worker()
    with _ONE_AT_A_TIME:
        return fit_one(replace(task, cores=task.cores or worker.state.nthreads), worker.address)


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
        return Ended(task.name, "failed", f"its worker died each time; tried {starts} times", starts=starts)
    except Exception as error:  # Dask's own, or of a worker that has no fit-material
        return Ended(task.name, "failed", f"{type(error).__name__}: {' '.join(str(error).split())}")
    finally:
        future.release()
