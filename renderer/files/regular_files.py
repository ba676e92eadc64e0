"""Files as they are read: regular ones alone. A pipe waits for somebody, and a device such as /dev/zero never ends."""

from __future__ import annotations

import stat
from pathlib import Path

from fit_material.renderer.compute.memory import require_memory
from fit_material.renderer.errors.input_error import InputError

_KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def special(path: str | Path) -> str | None:
    """What a path leads to, links followed, that is neither a regular file nor a folder; None for all others."""
    try:
        return _KINDS.get(stat.S_IFMT(Path(path).stat().st_mode))
    except (OSError, ValueError):  # whoever opens it will know
        return None


def require_regular(path: str | Path) -> None:
    """Refuse what exists and is no file that ends; a missing one is its reader's to refuse.

    Raises:
        InputError: a pipe, socket or device.
    """
    kind = special(path)
    if kind is not None:
        raise InputError(path, value=kind, expected="a regular file")


def require_file(path: Path, what: str) -> None:
    """Refuse whatever is no regular file.

    Args:
        what: is expected, "an image file".

    Raises:
        InputError: as `require_regular`; there is none, or a folder.
    """
    require_regular(path)
    if not path.is_file():
        raise InputError(path, expected=f"{what} here, but there is none")


def read_bytes(path: Path) -> bytes:
    """A whole file.

    Raises:
        InputError: a pipe, socket or device; more than memory holds.
        OSError: it cannot be read.
    """
    require_regular(path)
    require_memory(path, path.stat().st_size)
    return path.read_bytes()


def read_text(path: Path, encoding: str) -> str:
    """A whole file's text; raises what `read_bytes` does, and UnicodeDecodeError."""
    text = read_bytes(path).decode(encoding)
    return text.replace("\r\n", "\n").replace("\r", "\n")  # as Python's own reading of text has it
