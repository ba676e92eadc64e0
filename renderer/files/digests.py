"""SHA-256 of files: whether one is still what it was."""

from __future__ import annotations

import hashlib
from pathlib import Path

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import require_regular


def sha256_of(path: str | Path) -> str:
    """SHA-256 of a file's bytes, 64 lower-case hexadecimal digits.

    Raises:
        InputError: the file cannot be read.
    """
    require_regular(path)
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(path, expected=f"a file that can be read ({error.strerror})") from error


def sha256_or_none(path: Path) -> str | None:
    """SHA-256 of a file's bytes; None where it cannot be read, or is a link or no regular file."""
    if path.is_symlink():
        return None
    try:
        return sha256_of(path)
    except InputError:
        return None
