"""Shared libraries that leave a mark when they are loaded, in places where Mitsuba may look for its own."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from pathlib import Path

MARK = "loaded"  # a file beside the library
SOURCE = """
#include <stdio.h>
__attribute__((constructor)) static void loaded(void) {{
    FILE *file = fopen("{mark}", "w");
    if (file) fclose(file);
}}
"""


def hostile_library(path: Path, mark: Path) -> None:
    """A library that makes the file `mark` when it is loaded; without a compiler, one that cannot be loaded."""
    compiler = shutil.which("cc")
    if compiler is None:
        path.write_bytes(b"no library: whoever loads it fails")
        return
    source = path.with_suffix(".c")
    source.write_text(SOURCE.format(mark=mark))
    subprocess.run([compiler, "-shared", "-fPIC", "-o", path, source], check=True)


def mitsuba_folder() -> Path:
    """Where Mitsuba is installed."""
    found = importlib.util.find_spec("mitsuba")
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).parent


def hostile_plugins(folder: Path, mark: Path) -> None:
    """A hostile library of the name of each of Mitsuba's plugins, in `folder/plugins`; its tables of data spoilt."""
    hostile_library(folder / "hostile.so", mark)
    (folder / "plugins").mkdir()
    for plugin in (mitsuba_folder() / "plugins").glob("*.so"):
        (folder / "plugins" / plugin.name).symlink_to(folder / "hostile.so")
    for table in (mitsuba_folder() / "data").rglob("*"):
        if table.is_file():
            spoilt = folder / table.relative_to(mitsuba_folder())
            spoilt.parent.mkdir(parents=True, exist_ok=True)
            spoilt.write_bytes(b"")
