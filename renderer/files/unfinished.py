"""Hidden names for work that is under way: each names the process that does it, so that only a dead one's is swept."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fit_material.renderer.files.moves import finish

PREFIX = ".unfinished-"
ENDED = ("Z", "X")  # states of /proc/PID/stat: a zombie works no more
SILENT = 7 * 86400  # seconds without a change, after which work of an unreachable process is given up

_NAME = re.compile(
    rf"{re.escape(PREFIX)}"
    r"(?:(?P<machine>[0-9a-f]{8})-(?P<boot>[0-9a-f]{8})-(?P<pid>[1-9]\d*)-(?P<start>\d+)-)?\w{8}"
)


def prefix_here() -> str:
    """How this process's unfinished names begin: machine, boot, process and its start, in clock ticks since the boot.

    Eight more letters make it one name; it is short, so that a disk that takes the final name takes this one.
    """
    pid = os.getpid()
    return f"{PREFIX}{_machine()}-{_boot()}-{pid}-{_state(pid)[1]}-"


def sweep(directory: Path) -> None:
    """Remove what dead processes have left unfinished in that folder; what may be a living one's stays.

    Files that a dead one was just moving into `directory` are moved first.
    """
    with suppress(OSError):
        for path in directory.glob(f"{PREFIX}*"):
            if is_abandoned(path):
                finish(path, directory)
                _remove(path)


@contextmanager
def unfinished_folder(directory: Path) -> Iterator[Path]:
    """A new, hidden folder in `directory`, which is removed at the end; before, what dead processes have left there."""
    sweep(directory)
    folder = Path(tempfile.mkdtemp(prefix=prefix_here(), dir=directory))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def is_abandoned(path: Path) -> bool:
    """Whether no process works on that file or folder any more.

    Its process is looked up where it would run: on this machine, since it was started last. Of another machine, as on
    network disks, of another container, and of versions that named no process, only a week of silence decides.
    """
    match = _NAME.fullmatch(path.name)
    if match is None:
        return False
    if match["machine"] != _machine():
        return time.time() - _last_change(path) > SILENT
    return match["boot"] != _boot() or not _lives(int(match["pid"]), int(match["start"]))


def _lives(pid: int, start: int) -> bool:
    """Whether the process that began then still runs: numbers are given again to later ones."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # it is somebody else's
        pass
    state, started = _state(pid)
    return state not in ENDED and started in (start, 0)


def _state(pid: int) -> tuple[str, int]:
    """A process's state, and its start in clock ticks since the machine's; "" and 0 where they cannot be looked up."""
    try:  # the name of the program, in brackets, may hold anything
        words = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
        return words[0].decode("ascii"), int(words[19])
    except (OSError, ValueError, IndexError):
        return "", 0


def _machine() -> str:
    """This machine, and of its containers this one: process numbers of others mean nothing here."""
    return _digest(_text("/etc/machine-id"), platform.node(), _link("/proc/self/ns/pid"))


def _boot() -> str:
    """The machine's last start."""
    return _digest(_text("/proc/sys/kernel/random/boot_id"))


def _digest(*words: str) -> str:
    return hashlib.sha256("\n".join(words).encode("utf-8", "replace")).hexdigest()[:8]


def _text(path: str) -> str:
    try:
        return Path(path).read_text("utf-8", "replace").strip()
    except OSError:
        return ""


def _link(path: str) -> str:
    try:
        return os.readlink(path)
    except OSError:
        return ""


def _last_change(path: Path) -> float:
    """Of the file, or of whatever is in the folder; now, where it goes meanwhile."""
    times = []
    for each in (path, *path.rglob("*")):
        with suppress(OSError):
            times.append(each.lstat().st_mtime)
    return max(times, default=time.time())


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()
