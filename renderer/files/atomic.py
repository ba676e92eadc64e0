"""Files appear whole or not at all: written under another name, then renamed."""

from __future__ import annotations

import errno
import filecmp
import os
import shutil
import tempfile
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.moves import move
from fit_material.renderer.files.replaceable import ANYTHING, Replaceable
from fit_material.renderer.files.unfinished import prefix_here, sweep

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # nothing is wrong with what was to be written
LONGEST_NAME = 255  # bytes, where a disk gives none


def write_text_atomically(path: str | Path, text: str) -> None:
    """Write `text` `in_utf8`; see `write_bytes_atomically`."""
    write_bytes_atomically(path, in_utf8(text))


def in_utf8(text: str) -> bytes:
    """Text as our files have it: UTF-8 without byte-order mark.

    What UTF-8 has no bytes for, as names of files may have, is written as `\\udcHH`, which JSON reads back.
    """
    return text.encode("utf-8", "backslashreplace")


def write_bytes_atomically(path: str | Path, data: bytes) -> None:
    """Write a file that is seen either whole or, if anything interrupts the writing, as it was before.

    What dead processes have left unfinished beside it is swept.

    Raises:
        InputError: the file cannot be written there; the operating system's reason is in the sentence.
    """
    path = Path(path)
    sweep(path.parent)
    # not tempfile: its files are readable by their owner alone, and stay so when renamed
    temporary = path.with_name(f"{prefix_here()}{uuid.uuid4().hex[:8]}")
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(path, expected=f"a file that can be written ({error.strerror})") from error
    finally:
        with suppress(OSError):  # gone already if all went well
            temporary.unlink()


@contextmanager
def replaced_together(
    directory: str | Path,
    *,
    last: str = "result.json",
    option: str = "-o",
    replaceable: Replaceable = ANYTHING,
    size: int = 0,
) -> Iterator[Path]:
    """Lend a temporary folder whose files replace those of `directory` when the block ends well.

    If the block raises anything, KeyboardInterrupt included, `directory` keeps every file it had; one that was made for
    it goes again. A block that ended well replaces all files, though its process dies meanwhile: the next one that
    works in `directory` moves the rest (`files.moves`). What else dead processes left unfinished there is swept.

    Args:
        directory: the folder to fill, made if it is not there. Files with other names are left alone.
        last: the file moved after all others, so that whoever sees the new one sees all of them.
        option: the command-line option that named the folder, for the error's sentence.
        replaceable: which files of `directory` may be replaced by others; looked at before the first is moved.
        size: bytes that the block will write, or about so many: an error at once where the disk has no room for them.

    Yields:
        An empty folder inside `directory`; files in its subfolders keep their relative path.

    Raises:
        InputError: `directory` is not a folder that can be written, its disk is full, or a folder or a file that may
            not be replaced stands where a file goes.
    """
    directory = Path(directory)
    new = not directory.exists()
    temporary = _folder_inside(directory, option)
    try:
        _require_room(directory, size, option)
        with _full_disk_reported(temporary, directory, option):
            yield temporary
        _move_files(temporary, directory, last, option, replaceable)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        if new:
            with suppress(OSError):  # it is not empty: all went well
                directory.rmdir()


def require_names(directory: Path, names: Iterable[str], what: str) -> None:
    """Refuse names that are too long for the disk, before the work that is to be kept under them.

    Args:
        directory: where they go, if it is there already.
        names: of files.
        what: they are called after, for the error's sentence: its option or file.

    Raises:
        InputError: about the first of them.
    """
    longest = _longest_name(directory)
    for name in names:
        if (length := len(os.fsencode(name))) > longest:
            expected = f"a shorter name: the disk takes {longest} bytes, and {name[:40]}… has {length}"
            raise InputError(what, expected=expected)


def _longest_name(directory: Path) -> int:
    try:
        return os.pathconf(directory, "PC_NAME_MAX")
    except (OSError, ValueError, AttributeError):
        return LONGEST_NAME


def _folder_inside(directory: Path, option: str) -> Path:
    """A new, hidden folder in `directory`, which is made if need be: then renaming never crosses disks."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        sweep(directory)
        return Path(tempfile.mkdtemp(prefix=prefix_here(), dir=directory))
    except OSError as error:
        raise _not_writable(directory, option, error) from error


def _require_room(directory: Path, size: int, option: str) -> None:
    free = shutil.disk_usage(directory).free
    if size > free:
        expected = f"a disk with {_megabytes(size)} free for what is to be written, but it has {_megabytes(free)}"
        raise InputError(option, value=directory, expected=expected)


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.3g} MB"


@contextmanager
def _full_disk_reported(temporary: Path, directory: Path, option: str) -> Iterator[None]:
    """A sentence about the folder that was named, and not about a temporary one, where the disk takes no more."""
    try:
        yield
    except (OSError, InputError) as error:
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError) or cause.errno not in FULL:
            raise
        if isinstance(error, InputError) and temporary not in Path(error.file).parents:
            raise
        raise _not_writable(directory, option, cause) from cause


def _move_files(source: Path, directory: Path, last: str, option: str, replaceable: Replaceable) -> None:
    names = [path.relative_to(source) for path in source.rglob("*") if path.is_file()]
    names.sort(key=lambda name: (name.as_posix() == last, name))
    for name in names:  # all looked at before the first is moved
        if (directory / name).is_dir():
            raise InputError(option, value=directory / name, expected="a place for a file, not a folder")
    names = [name for name in names if not _same_bytes(source / name, directory / name)]
    replaceable.require(directory, names, option)
    try:
        move(source, directory, names)
    except OSError as error:
        raise _not_writable(directory, option, error) from error


def _same_bytes(new: Path, old: Path) -> bool:
    """Whether there is nothing to do: a file of these bytes may even be an input."""
    try:
        return old.is_file() and filecmp.cmp(new, old, shallow=False)
    except OSError:
        return False


def _not_writable(directory: Path, option: str, error: OSError) -> InputError:
    return InputError(option, value=directory, expected=f"a folder that can be written ({error.strerror})")
