"""How far a command is, as a bar on the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from renderer.printable import printable

Progress = Callable[[str, float], None]
"""Told a stage of the work and the share of it that is done, in [0, 1]."""


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Progress]:
    """A progress bar on the terminal's standard error; nothing where it is no terminal or not wanted."""
    if quiet or not sys.stderr.isatty():
        yield lambda stage, share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description:24}", markup=False), BarColumn(), TimeElapsedColumn())
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, object] = {}

        def show(stage: str, share: float) -> None:
            if stage not in tasks:
                for done in tasks.values():
                    bars.update(done, completed=1)  # type: ignore[arg-type]
                tasks[stage] = bars.add_task(printable(stage), total=1)
            bars.update(tasks[stage], completed=share)  # type: ignore[arg-type]

        yield show
