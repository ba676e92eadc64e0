"""Where and with what a benchmark ran, and where it keeps its files."""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from tests.support.paths import ROOT

CACHE = Path(os.environ.get("FIT_MATERIAL_CACHE", Path.home() / ".cache" / "fit-material"))
PACKAGES = ("torch", "jax", "optimistix", "mitsuba", "drjit", "moderngl", "numpy")


def header() -> str:
    """Commit, machine and versions, in two lines of Markdown."""
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()
    load = os.getloadavg()[0]
    machine = f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f} at the start"
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return f"commit {commit} · {machine} · Python {platform.python_version()}\n{packages}\n"


def spread(values: Sequence[float]) -> str:
    """Median and range."""
    return f"{statistics.median(values):.3g} ({min(values):.3g} … {max(values):.3g})"
