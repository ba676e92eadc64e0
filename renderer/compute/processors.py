"""Cores of this machine."""

from __future__ import annotations

import os


def usable_cores() -> int:
    """Cores that this process may use; only Linux distinguishes them from those of the machine."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
