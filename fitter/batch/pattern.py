"""Paths that match a shell's pattern, of which no folder is looked into twice, wherever links lead."""

from __future__ import annotations

import fnmatch
import glob
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

ANY_DEPTH = "**"


def matching(pattern: str, folder: Path) -> list[Path]:
    """Files and folders that match, as `glob.glob(recursive=True)` finds them, but for two things:

    of a linked folder `**` finds the contents, but nothing below, and of several paths to one folder the shortest
    alone is followed. So the effort grows with the number of files, not with the number of paths to them.

    Args:
        pattern: relative to `folder`, or absolute, or from "~"; its parts may have `*`, `?`, `[…]`, or be `**`.
    """
    path = Path(pattern).expanduser()
    found = [Path(path.anchor) if path.is_absolute() else folder]
    parts = path.relative_to(path.anchor).parts
    for index, part in enumerate(parts):
        last = index == len(parts) - 1
        steps = (each for base in found for each in _step(base, part, last))
        found = list(steps) if last else _once(each for each in steps if each.is_dir())
    return list(dict.fromkeys(found))


def _step(base: Path, part: str, last: bool) -> Iterator[Path]:
    """What one part of a pattern matches in a folder."""
    if part == ANY_DEPTH:
        yield from _below(base, files=last)
    elif glob.has_magic(part):
        matches = re.compile(fnmatch.translate(part)).match
        yield from (base / name for name in _names(base, part.startswith(".")) if matches(name))
    elif os.path.lexists(base / part):
        yield base / part


def _below(base: Path, files: bool) -> Iterator[Path]:
    """A folder and those in it, however deep, but hidden ones; with the files in them, or without."""
    for folder, folders, names in os.walk(base):  # which leaves links alone
        folders[:] = [name for name in folders if not name.startswith(".")]
        yield Path(folder)
        linked = [name for name in folders if os.path.islink(os.path.join(folder, name))]
        shown = [name for name in names if files and not name.startswith(".")]
        yield from (Path(folder, name) for name in (*linked, *shown))


def _names(folder: Path, hidden: bool) -> list[str]:
    try:
        return [name for name in os.listdir(folder) if hidden or not name.startswith(".")]
    except OSError:  # no folder, or one that may not be looked into
        return []


def _once(folders: Iterable[Path]) -> list[Path]:
    """The shortest path to each folder, of several the first."""
    first: dict[str, Path] = {}
    for folder in sorted(folders, key=lambda each: (len(each.parts), each)):
        first.setdefault(os.path.realpath(folder), folder)
    return list(first.values())
