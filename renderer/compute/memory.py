"""How much memory is free for what a file is about to become: refused in a sentence before it is taken."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from fit_material.renderer.errors.input_error import InputError

GIGABYTE = 10**9
PROC, CGROUPS = Path("/proc/self"), Path("/sys/fs/cgroup")


def require_memory(path: str | Path, taken: float, field: str = "", value: object = "") -> None:
    """Refuse what would take more memory than there is.

    Args:
        path, field, value: of the input at fault, as `InputError` has them.
        taken: bytes that it takes at least.

    Raises:
        InputError: with both numbers.
    """
    free = available_memory()
    if taken > free:
        numbers = f"reading it takes {taken / GIGABYTE:.3g} GB, and {free / GIGABYTE:.3g} GB are free"
        raise InputError(path, field, value, f"what fits into memory: {numbers}")


def available_memory() -> int:
    """Bytes that this process may still take: the rest of the machine's, its control group's and its own limit."""
    import psutil

    return max(0, min(psutil.virtual_memory().available, address_space(), *control_groups()))


def address_space() -> int:
    """Bytes that RLIMIT_AS (`ulimit -v`) leaves to this process."""
    import psutil

    limit = address_limit()
    return sys.maxsize if limit is None else limit - psutil.Process().memory_info().vms


def address_limit() -> int | None:
    """RLIMIT_AS in bytes; None where there is none."""
    with suppress(ImportError):  # Windows
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        return None if limit == resource.RLIM_INFINITY else limit
    return None


def memory_limit() -> int:
    """Bytes that this process and those it starts may take together: the machine's, or those of its control groups."""
    import psutil

    return min([psutil.virtual_memory().total, *control_group_limits()])


def control_groups(proc: Path = PROC, root: Path = CGROUPS) -> Iterator[int]:
    """Bytes that each limit of this process's control groups leaves; files in memory are given up.

    Args:
        proc, root: as `_control_groups` has them.
    """
    for folder, files in _control_groups(proc, root):
        with suppress(OSError, ValueError):  # a group that is not seen from here, or "max"
            most, used = (int((folder / file).read_text()) for file in (files.limit, files.usage))
            entries = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
            yield most - used + int(entries.get(files.cached, 0))


def control_group_limits(proc: Path = PROC, root: Path = CGROUPS) -> Iterator[int]:
    """Bytes of each limit of this process's control groups, whatever is used of them.

    Args:
        proc, root: as `_control_groups` has them.
    """
    for folder, files in _control_groups(proc, root):
        with suppress(OSError, ValueError):  # as above
            yield int((folder / files.limit).read_text())


@dataclass(frozen=True)
class _Files:
    """What one version of control groups calls its files, and cached files in `memory.stat`."""

    limit: str
    usage: str
    cached: str


VERSION_1 = _Files("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
VERSION_2 = _Files("memory.max", "memory.current", "inactive_file")


def _control_groups(proc: Path, root: Path) -> Iterator[tuple[Path, _Files]]:
    """Folders of this process's groups for memory, of version 1 or 2, and of those around them; none but on Linux.

    Args:
        proc: holds `cgroup`, the groups' names: lines such as `0::/a/b`, of version 2, or `4:memory:/a/b`.
        root: where the groups' folders are.
    """
    with suppress(OSError, ValueError):  # no Linux, or nothing that may be read
        for line in (proc / "cgroup").read_text().splitlines():
            _, controllers, name = line.split(":", 2)
            if controllers == "":
                yield from ((folder, VERSION_2) for folder in _around(root, name))
            elif "memory" in controllers.split(","):
                yield from ((folder, VERSION_1) for folder in _around(root / "memory", name))


def _around(root: Path, name: str) -> list[Path]:
    """A group's folder and those around it; in a container, the outermost that is seen is the root."""
    group = root / name.lstrip("/")
    return [group, *(each for each in group.parents if each.is_relative_to(root))]
