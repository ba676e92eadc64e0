"""A progress bar for terminals."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from fit_material.fitter.options.progress import Progress
from fit_material.renderer.errors.printable import printable


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
