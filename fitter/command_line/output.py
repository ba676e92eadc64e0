"""Printing to a standard output that somebody may have closed, `| head` and `>&-` do, or that is full."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from fit_material.renderer.errors.printable import printable, printable_lines


class Unwritable(Exception):
    """Standard output takes no more; a sentence with the reason."""


def say(*words: object) -> None:
    """Print, if anybody reads it; what names from files hold beside letters does not reach the terminal.

    Raises:
        Unwritable: somebody would, but it cannot be written.
    """
    with _unread():
        print(*(printable_lines(str(word)) for word in words), flush=True)


def complain(sentence: str) -> None:
    """Print a sentence to standard error, if anybody reads it."""
    with suppress(OSError):
        print(f"fit-material: {printable(sentence)}", file=sys.stderr, flush=True)


def flush() -> None:
    """Flush what was printed; raises what `say` does."""
    with _unread():
        sys.stdout.flush()


@contextmanager
def _unread() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())  # or Python would fail once more at its end
        os.close(nowhere)
        if not isinstance(error, BrokenPipeError):
            raise Unwritable(f"standard output cannot be written ({error.strerror})") from error


def open_streams() -> None:
    """Standard streams that are closed lead nowhere: the next file opened would take their place, and be printed to."""
    for descriptor, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(descriptor)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)  # takes the lowest that is free, which is this one
            os.set_inheritable(nowhere, True)
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(descriptor, mode, encoding="utf-8", closefd=False))
