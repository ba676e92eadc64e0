"""Standard streams led elsewhere for a while, also of libraries that write to them past Python."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

LAST_STREAM = 2  # standard error

_lock = threading.RLock()  # the streams are the process's: who came second would restore what the first had put there


@contextmanager
def redirected(descriptors: Sequence[int], target: int) -> Iterator[None]:
    """Inside the block, output to `descriptors` goes to `target`; one that was closed is closed again.

    Args:
        descriptors: of standard streams.
        target: of a file open for writing; it may have taken the place of a closed stream.
    """
    with _lock:
        kept, aim = {each: _copy(each) for each in descriptors}, _copy(target)
        assert aim is not None
        try:
            for each in descriptors:
                os.dup2(aim, each)
            yield
        finally:
            os.close(aim)
            for each, copy in kept.items():
                _restore(each, copy)


def _copy(descriptor: int) -> int | None:
    """One more descriptor of the same file, none of a standard stream's; None of a closed one."""
    copies: list[int] = []
    try:
        while not copies or copies[-1] <= LAST_STREAM:
            copies.append(os.dup(descriptor))
    except OSError:
        return None
    for each in copies[:-1]:
        os.close(each)
    return copies[-1]


def _restore(descriptor: int, copy: int | None) -> None:
    if copy is None:
        os.close(descriptor)
    else:
        os.dup2(copy, descriptor)
        os.close(copy)
