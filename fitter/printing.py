"""Printing to a standard output that somebody may have closed: `| head` does."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


def say(*words: object) -> None:
    """Print, if anybody reads it."""
    with _unread():
        print(*words, flush=True)


def flush() -> None:
    """What was printed is on its way, if anybody reads it."""
    with _unread():
        sys.stdout.flush()


@contextmanager
def _unread() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())  # or Python would fail once more at its end
        os.close(nowhere)
