"""Files appear whole or not at all: written under another name, then renamed."""

from __future__ import annotations

import os
import shutil
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from renderer.errors import InputError


def write_text_atomically(path: str | Path, text: str) -> None:
    """Write `text` as UTF-8 without byte-order mark; see `write_bytes_atomically`."""
    write_bytes_atomically(path, text.encode("utf-8"))


def write_bytes_atomically(path: str | Path, data: bytes) -> None:
    """Write a file that is seen either whole or, if anything interrupts the writing, as it was before.

    Raises:
        InputError: the file cannot be written there; the operating system's reason is in the sentence.
    """
    path = Path(path)
    # not tempfile: its files are readable by their owner alone, and stay so when renamed
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(path, expected=f"a file that can be written ({error.strerror})") from error
    finally:
        with suppress(OSError):  # gone already if all went well
            temporary.unlink()


@contextmanager
def replaced_together(directory: str | Path, *, last: str = "result.json", option: str = "-o") -> Iterator[Path]:
    """Lend a temporary folder whose files replace those of `directory` when the block ends well.

    If the block raises anything, KeyboardInterrupt included, `directory` keeps every file it had; one that was made for
    it goes again.

    Args:
        directory: the folder to fill, made if it is not there. Files with other names are left alone.
        last: the file moved after all others, so that whoever sees the new one sees all of them.
        option: the command-line option that named the folder, for the error's sentence.

    Yields:
        An empty folder inside `directory`; files in its subfolders keep their relative path.

    Raises:
        InputError: `directory` is not a folder that can be written, or a folder stands where a file goes.
    """
    directory = Path(directory)
    new = not directory.exists()
    temporary = _folder_inside(directory, option)
    try:
        yield temporary
        _move_files(temporary, directory, last, option)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        if new:
            with suppress(OSError):  # it is not empty: all went well
                directory.rmdir()


def _folder_inside(directory: Path, option: str) -> Path:
    """A new, hidden folder in `directory`, which is made if need be: then renaming never crosses disks."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=".unfinished-", dir=directory))
    except OSError as error:
        raise _not_writable(directory, option, error) from error


def _move_files(source: Path, directory: Path, last: str, option: str) -> None:
    names = [path.relative_to(source) for path in source.rglob("*") if path.is_file()]
    names.sort(key=lambda name: (name.as_posix() == last, name))
    for name in names:  # all looked at before the first is moved
        if (directory / name).is_dir():
            raise InputError(option, value=directory / name, expected="a place for a file, not a folder")
    try:
        for name in names:
            (directory / name).parent.mkdir(parents=True, exist_ok=True)
            os.replace(source / name, directory / name)
    except OSError as error:
        raise _not_writable(directory, option, error) from error


def _not_writable(directory: Path, option: str, error: OSError) -> InputError:
    return InputError(option, value=directory, expected=f"a folder that can be written ({error.strerror})")
