"""Work shared among cores by pieces, each piece on one core.

Torch shares every single operation among cores and waits for the slowest after each. Ours are short: on a busy machine
the waiting took three quarters of the time. Whole pieces of work in threads wait for each other only at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

from fit_material.renderer.compute.processors import usable_cores

Item = TypeVar("Item")
Made = TypeVar("Made")


@contextmanager
def one_thread_per_operation() -> Iterator[None]:
    """Torch's operations run on the core that calls them, inside the block and in threads begun inside it."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def map_in_threads(work: Callable[[Item], Made], items: Iterable[Item]) -> Iterator[Made]:
    """`map`, on as many threads as this process has cores; what has not begun is dropped where the caller stops."""
    with one_thread_per_operation(), ThreadPoolExecutor(cores()) as pool:
        yield from pool.map(work, items)


def one_ahead(work: Callable[[Item], Made], items: Iterable[Item]) -> Iterator[Made]:
    """`map`, the next piece being made in a thread while the caller is busy with the last; no more than two exist."""
    with ThreadPoolExecutor(1) as pool:
        pending = None
        for item in items:
            made, pending = pending, pool.submit(work, item)
            if made is not None:
                yield made.result()
        if pending is not None:
            yield pending.result()


_limit: list[int] = []


def limit_cores(count: int) -> None:
    """From now on this process computes on so many cores at a time: torch, Dr.Jit, and the threads of this module.

    Where several processes have a share of the machine each, those that took all of it would wait for each other.
    """
    import drjit

    _limit[:] = [count]
    torch.set_num_threads(count)
    drjit.set_thread_count(count)


def cores() -> int:
    """Cores that this process may use, by the system's limit and `limit_cores`'s."""
    return min([usable_cores(), *_limit])
