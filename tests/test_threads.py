"""Work in threads: the same as `map`, on any system."""

import os

import pytest

from renderer.threads import map_in_threads


@pytest.mark.parametrize("cores", [None, 3])
def test_systems_that_tell_no_cores_of_a_process(monkeypatch, cores):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    assert list(map_in_threads(abs, [-1, 2, -3])) == [1, 2, 3]
