"""Ctrl-C and SIGTERM, put off for a moment."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Ctrl-C and SIGTERM come after the block; a process that is begun inside holds them from its first instruction.

    To block them is not enough: the system then gives them to another thread, and Python takes them to the main one.
    """
    came: list[int] = []
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPTS)
    main = threading.current_thread() is threading.main_thread()  # no other may set handlers
    handlers = {each: signal.signal(each, lambda number, frame: came.append(number)) for each in INTERRUPTS if main}
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, masked)  # what was blocked comes here
        for each, handler in handlers.items():
            signal.signal(each, handler or signal.SIG_DFL)
        for each in came:
            os.kill(os.getpid(), each)
