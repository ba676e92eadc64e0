"""Notices that a file was changed on disk, by looking now and then."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

Stamp = tuple[int, int, int] | None

INTERVAL = 0.5  # seconds between two looks


class Watch:
    """Files whose changes are to be noticed.

    Polled, not notified: editors replace files, network disks send no events, and a handful of `stat` calls twice a
    second costs nothing.
    """

    def __init__(self, files: Iterable[Path]) -> None:
        self.files: tuple[Path, ...] = ()
        self.follow(files)

    def follow(self, files: Iterable[Path]) -> None:
        """Watch these files from now on, as they are now."""
        self.files = tuple(dict.fromkeys(files))
        self._known = self._seen = self._stamps()

    def changed(self) -> bool:
        """Whether something changed since `follow` or the last time that this was true.

        A change is reported once it has stayed the same for two looks, so that a file is not read while another program
        still writes it.
        """
        now = self._stamps()
        settled = now == self._seen and now != self._known
        self._seen = now
        if settled:
            self._known = now
        return settled

    def _stamps(self) -> tuple[Stamp, ...]:
        return tuple(_stamp(path) for path in self.files)


def _stamp(path: Path) -> Stamp:
    """What differs after a file was written or replaced; None where there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
