"""Which files of a folder a command may replace: what it has written itself, and never what it reads."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.digests import sha256_or_none
from fit_material.renderer.files.regular_files import read_text


@dataclass(frozen=True)
class Replaceable:
    """A predicate that decides whether an existing file may be replaced.

    Attributes:
        inputs: files that the command reads.
        own: those that it wrote there earlier, by name relative to the folder, with the SHA-256 that they had; None
            instead of that where it is not known.
        known: such files in words, "one that …", for the error's sentence; "" lets all but inputs be replaced.
    """

    inputs: tuple[Path, ...] = ()
    own: Mapping[str, str | None] = field(default_factory=dict)
    known: str = ""

    def require(self, directory: Path, names: Iterable[str | Path], option: str = "-o") -> None:
        """Look at all files of those names that are there.

        Raises:
            InputError: about the first that may not be replaced.
        """
        read = {identity for path in self.inputs if (identity := _identity(path)) is not None}
        for name in names:
            path = directory / name
            if not os.path.lexists(path):
                continue
            if _identity(path) in read:
                raise InputError(option, value=path, expected="another place: an input is never overwritten")
            if self.known and not self._is_own(path, Path(name).as_posix()):
                expected = f"no file of that name, or {self.known}; move it, or name another place"
                raise InputError(option, value=path, expected=expected)

    def _is_own(self, path: Path, name: str) -> bool:
        return name in self.own and (now := sha256_or_none(path)) is not None and self.own[name] in (None, now)


ANYTHING = Replaceable()


def _identity(path: Path) -> tuple[int, int] | None:
    """The same for all names of one file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def contents(folder: Path) -> dict[str, str]:
    """The SHA-256 of each file in a folder, by name."""
    digests = {path.name: sha256_or_none(path) for path in sorted(folder.iterdir())}
    return {name: digest for name, digest in digests.items() if digest is not None}


def unchanged(folder: Path, own: Mapping[str, str | None]) -> dict[str, str]:
    """Those of `own` that a folder still holds as they were, with their SHA-256; names that lead elsewhere are none."""
    plain = {name: digest for name, digest in own.items() if Path(name).name == name}
    now = {name: sha256_or_none(folder / name) for name in plain}
    return {name: digest for name, digest in now.items() if digest is not None and plain[name] in (None, digest)}


def json_with(path: Path, *keys: str) -> dict[str, Any] | None:
    """The JSON object in a file of ours, known by its keys; None where there is none, or it is something else."""
    try:
        data = json.loads(read_text(path, "utf-8")) if path.is_file() else None
    except (OSError, ValueError, RecursionError, InputError):
        return None
    return data if isinstance(data, dict) and data.keys() >= {*keys} else None
