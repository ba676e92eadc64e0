"""Files of an unfinished folder move into the one around it, all of them, though their process dies meanwhile."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from fit_material.renderer.files.digests import sha256_or_none
from fit_material.renderer.files.replaceable import json_with

JOURNAL = ".moves"  # in the unfinished folder, from the moment on when all that is to be moved is there


def move(source: Path, directory: Path, names: Sequence[Path]) -> None:
    """Move files to the same names in `directory`, in that order.

    Raises:
        OSError: one of them cannot be moved.
    """
    _write_journal(source, {name.as_posix(): _state(directory / name) for name in names})
    for name in names:
        (directory / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(source / name, directory / name)


def finish(source: Path, directory: Path) -> None:
    """End a move that the death of its process interrupted; files that changed since, or came, stay as they are."""
    for name, state in (json_with(source / JOURNAL) or {}).items():
        with suppress(OSError):
            if _is_plain(name) and (source / name).is_file() and _state(directory / name) == state:
                os.replace(source / name, directory / name)


def _state(path: Path) -> str | None:
    """SHA-256 of what would be replaced; None where there is nothing, "" where it is no regular file."""
    return (sha256_or_none(path) or "") if os.path.lexists(path) else None


def _is_plain(name: str) -> bool:
    """Whether it leads nowhere but into the folder itself, whoever wrote it."""
    return Path(name).name == name


def _write_journal(source: Path, states: dict[str, str | None]) -> None:
    """Whole or not at all, as it marks that all files are there."""
    unready = source / f"{JOURNAL}.new"
    unready.write_text(json.dumps(states), "utf-8")
    os.replace(unready, source / JOURNAL)
