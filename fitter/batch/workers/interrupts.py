"""Ctrl-C, SIGTERM and SIGHUP, put off for a moment."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # those that `cli` makes KeyboardInterrupt of


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Interrupts come after the block; a process that is started inside holds them from its first instruction.

    To block them is not enough: the system then gives them to another thread, and Python takes them to the main one.
    What is ignored, as SIGHUP by `nohup`, stays so: a process that is started would not inherit that from a handler.
    """
    came: list[int] = []
    heeded = [each for each in INTERRUPTS if signal.getsignal(each) != signal.SIG_IGN]
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, heeded)
    main = threading.current_thread() is threading.main_thread()  # no other may set handlers
    handlers = {each: signal.signal(each, lambda number, frame: came.append(number)) for each in heeded if main}
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, masked)  # what was blocked comes here
        for each, handler in handlers.items():
            signal.signal(each, handler or signal.SIG_DFL)
        for each in came:
            os.kill(os.getpid(), each)
