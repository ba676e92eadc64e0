"""The log of a batch: a line of JSON for every result that was taken over, in the order of time."""

from __future__ import annotations

import json
import os
import stat
from datetime import UTC, datetime
from pathlib import Path

from fit_material.fitter.batch.workers.record import Fitted
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.replaceable import Replaceable

LOG = "fits.jsonl"
KEYS = frozenset({"name", "scene", "key"})  # that every line has, beside others
LONGEST = 2**16  # bytes of a line, which has two paths at most


def require_own_log(out: Path) -> None:
    """Refuse a folder where somebody else's file has the log's name: lines would be appended to it.

    Raises:
        InputError: it is no regular file, or neither empty nor begun by a batch.
    """
    own: dict[str, str | None] = {LOG: None} if _is_log(out / LOG) else {}
    Replaceable(own=own, known="one of an earlier batch").require(out, [LOG])


def _is_log(path: Path) -> bool:
    if path.is_symlink() or not path.is_file():
        return False
    try:
        with open(path, "rb") as file:
            line = file.readline(LONGEST)
        first = json.loads(line) if line else dict.fromkeys(KEYS)
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(first, dict) and first.keys() >= KEYS


def append_to_log(out: Path, name: str, record: Fitted) -> None:
    """Note that a result was taken over now.

    Raises:
        InputError: the log cannot be written, or something else has come to its place meanwhile.
    """
    line = {
        "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "name": name,
        "scene": record.scene,
        "worker": record.worker,
        "starts": record.starts,
        "key": record.key,
    }
    try:
        with open(out / LOG, "a", encoding="utf-8", errors="backslashreplace", opener=_opened) as log:
            log.write(json.dumps(line, ensure_ascii=False) + "\n")
    except OSError as error:
        expected = f"a regular file that can be written ({error.strerror or error})"
        raise InputError("-o", value=out / LOG, expected=expected) from None


def _opened(path: str, flags: int) -> int:
    """No link is followed, and no pipe waited for."""
    handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
    if stat.S_ISREG(os.fstat(handle).st_mode):
        return handle
    os.close(handle)
    raise OSError("it is none")
