"""Changes on disk are noticed once, and not before the writing has come to an end."""

from __future__ import annotations

import os

import pytest

from fit_material.renderer.viewer.watch import Watch


@pytest.fixture
def files(tmp_path):
    paths = [tmp_path / name for name in ("ball.obj", "ball.mtl", "absent.png")]
    for path in paths[:2]:
        path.write_text("one", "utf-8")
    return paths


def looks(watch: Watch, count: int = 4) -> list[bool]:
    return [watch.changed() for _ in range(count)]


def test_nothing_happens(files):
    assert looks(Watch(files)) == [False] * 4


def rewrite(path):
    path.write_text("longer than before", "utf-8")


def touch(path):
    os.utime(path, ns=(1, 1))


def replace(path):
    """As editors save: another file of the same size and time takes the name."""
    status = path.stat()
    other = path.with_name("other")
    other.write_text("two", "utf-8")
    os.utime(other, ns=(status.st_atime_ns, status.st_mtime_ns))
    os.replace(other, path)


def remove(path):
    path.unlink()


@pytest.mark.parametrize("change", [rewrite, touch, replace, remove])
def test_a_change_is_told_once(files, change):
    watch = Watch(files)
    change(files[1])
    assert looks(watch) == [False, True, False, False]


def test_a_file_that_appears_is_a_change(files):
    watch = Watch(files)
    files[2].write_text("", "utf-8")
    assert looks(watch, 2) == [False, True]


def test_a_file_that_is_being_written_is_waited_for(files):
    watch = Watch(files)
    seen = []
    for size in range(4, 8):
        files[0].write_text("x" * size, "utf-8")
        seen.append(watch.changed())
    assert seen == [False] * 4
    assert looks(watch, 2) == [True, False]


def test_changed_and_back_is_no_change(files):
    watch = Watch(files)
    times = files[0].stat()
    os.utime(files[0], ns=(5, 5))
    assert not watch.changed()
    os.utime(files[0], ns=(times.st_atime_ns, times.st_mtime_ns))
    assert looks(watch) == [False] * 4


def test_following_other_files_forgets_the_first(files):
    watch = Watch(files[:1])
    touch(files[0])
    watch.follow([files[1], files[1]])
    assert watch.files == (files[1],)
    assert looks(watch) == [False] * 4
    touch(files[1])
    assert any(looks(watch))
