"""Work in threads: the same as `map`, on any system."""

import os
import subprocess
import sys

import pytest

from fit_material.renderer.compute.threads import map_in_threads, one_ahead


@pytest.mark.parametrize("cores", [None, 3])
def test_systems_that_tell_no_cores_of_a_process(monkeypatch, cores):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    assert list(map_in_threads(abs, [-1, 2, -3])) == [1, 2, 3]


def test_one_ahead_makes_the_next_piece_and_no_further():
    made = []

    def work(item: int) -> int:
        made.append(item)
        return -item

    pieces = one_ahead(work, range(5))
    assert [next(pieces) for _ in range(2)] == [0, -1]
    pieces.close()  # waits for the one that was begun
    assert made == [0, 1, 2]


@pytest.mark.parametrize("count", [0, 1, 4])
def test_one_ahead_gives_what_map_gives(count):
    assert list(one_ahead(abs, range(-count, 0))) == list(map(abs, range(-count, 0)))


def test_what_fails_ahead_is_raised_where_it_is_due():
    pieces = one_ahead(lambda item: 1 // item, [1, 0])
    assert next(pieces) == 1
    with pytest.raises(ZeroDivisionError):
        next(pieces)


def test_a_process_that_has_a_share_of_the_machine_takes_no_more():
    """In a process of its own: Dr.Jit and torch keep the number."""
    code = """
import drjit, os, torch
os.sched_getaffinity = lambda process: set(range(8))
from fit_material.renderer.compute import threads
assert threads.cores() == 8
threads.limit_cores(3)
print(threads.cores(), torch.get_num_threads(), drjit.thread_count())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("3 3 3\n", "")
