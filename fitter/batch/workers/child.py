"""A process of this machine's batch, from inside; what a fit needs is imported once the connection is being watched."""

from __future__ import annotations

import os
import pickle
import platform
import queue
import signal
import threading
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection
from typing import NoReturn


def serve(descriptor: int) -> NoReturn:
    """Fit what comes through the connection, until its other end is closed.

    Sends None once all is loaded that a fit needs, then for every `Task` an `Ended`.

    Args:
        descriptor: of this end of the connection.
    """
    # held while this process was started; Ctrl-C stays so
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM, signal.SIGHUP})
    os.set_inheritable(descriptor, False)
    connection, tasks = Connection(descriptor), queue.SimpleQueue()
    threading.Thread(target=_receive, args=(connection, tasks), daemon=True).start()
    with suppress(Exception):  # the first fit meets it again, and its outcome names it
        import_module("fit_material.fitter.pipeline.fit_scene")
    from fit_material.fitter.batch.workers.worker import fit_one

    connection.send(None)
    while True:
        connection.send(fit_one(pickle.loads(tasks.get()), f"process {os.getpid()} of {platform.node()}"))


def _receive(connection: Connection, tasks: queue.SimpleQueue[bytes]) -> NoReturn:
    """End the process, in the middle of a fit too, when the other end has closed: its results would be lost."""
    try:
        while True:
            tasks.put(connection.recv_bytes())
    except (EOFError, OSError):
        os._exit(0)
