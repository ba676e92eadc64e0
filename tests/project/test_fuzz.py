"""A fixed sample of the fuzz that `make stress` runs whole, and that it finds what it is there for."""

from __future__ import annotations

import time

import pytest

from tests.fuzz import readers
from tests.fuzz.readers import READERS, fuzzed, prepared, taken


@pytest.fixture
def tree(tmp_path):
    return prepared(tmp_path)


@pytest.mark.parametrize("kind", READERS)
def test_damaged_files_are_read_or_refused(kind, tree):
    assert fuzzed(kind, 150, 0, tree) == []


def test_an_input_is_made_again_by_its_number(tree):
    def failing(path):
        raise ValueError

    assert taken(failing, tree / "x", b"1") == "raises ValueError: "
    first, again = (fuzzed_data(tree, number) for number in (7, 7))
    assert first == again != fuzzed_data(tree, 8)


def fuzzed_data(tree, number: int) -> bytes:
    fuzzed("mtl", 1, 0, tree, number)
    return (tree / "ball.mtl").read_bytes()


def test_what_hangs_is_found(tree, monkeypatch):
    monkeypatch.setattr(readers, "SLOWEST", 0.01)
    assert "takes 0.0 s" in (taken(lambda path: time.sleep(0.02), tree / "x", b"") or "")


def test_what_looks_outside_of_the_tree_is_found(tree):
    def looking(path):
        (path.parent.parent / readers.SECRET).read_bytes()

    assert "outside" in (taken(looking, tree / "x", b"") or "")
