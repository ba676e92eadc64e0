"""Plots by matplotlib's own settings and ours, whatever the user's are: those may require LaTeX, or a display."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import ModuleType
from typing import Any

from fit_material.renderer.compute.first_import import Execute, at_first_import


def without_the_users_settings() -> None:
    """For a program of its own, before it imports matplotlib, which stops at some files and variables of its users."""
    os.environ["MATPLOTLIBRC"] = os.devnull
    os.environ["MPLBACKEND"] = "agg"
    at_first_import("matplotlib", _without_the_working_folder)


def _without_the_working_folder(execute: Execute, module: ModuleType) -> None:
    """Import matplotlib, to which a file `matplotlibrc` in the working folder, before all others, is not there."""
    exists, here = os.path.exists, threading.get_ident()

    def elsewhere(path: Any) -> bool:
        return not (path == "matplotlibrc" and threading.get_ident() == here) and exists(path)

    os.path.exists = elsewhere
    try:
        execute(module)
    finally:
        os.path.exists = exists


@contextmanager
def own_settings(ours: Mapping[Any, Any]) -> Iterator[None]:
    """Inside, plots have matplotlib's defaults but for `ours`."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(ours)
        yield
