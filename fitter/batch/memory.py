"""Memory that this process and those it begins may take together."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

GROUPS = Path("/sys/fs/cgroup")


def memory_limit() -> int:
    """Bytes: the machine's, or those of the smallest control group around this process, a container's among them."""
    return min([os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"), *group_limits()])


def group_limits(groups: Path = GROUPS, own: Path = Path("/proc/self/cgroup")) -> Iterator[int]:
    """Limits of this process's control groups and of those around them, of both versions; none but on Linux.

    Args:
        groups: where they are mounted.
        own: lines such as `0::/a/b`, of version 2, or `4:memory:/a/b`.
    """
    with suppress(OSError):
        for line in own.read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            if not controllers:
                yield from _limits(groups, path, "memory.max")
            elif "memory" in controllers.split(","):
                yield from _limits(groups / "memory", path, "memory.limit_in_bytes")


def _limits(root: Path, path: str, name: str) -> Iterator[int]:
    """Of a group and those around it; in a container the path may be the host's, of which only the root is there."""
    group = root / path.lstrip("/")
    for each in (group, *group.parents):
        if each.is_relative_to(root):
            with suppress(OSError, ValueError):  # the word max, for one
                yield int((each / name).read_text())
