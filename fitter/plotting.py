"""Plots by matplotlib's own settings and ours, whatever the user's are: those may ask for LaTeX, or a display."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any


def without_the_users_settings() -> None:
    """For a program of its own, before it imports matplotlib, which stops at some files and variables of its users."""
    os.environ["MATPLOTLIBRC"] = os.devnull
    os.environ["MPLBACKEND"] = "agg"


@contextmanager
def own_settings(ours: Mapping[Any, Any]) -> Iterator[None]:
    """Inside, what is drawn has matplotlib's defaults but for `ours`."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(ours)
        yield
