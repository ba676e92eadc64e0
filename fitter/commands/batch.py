"""The arguments of `fit-material batch`, and what it prints; heavy imports are late."""

from __future__ import annotations

import functools
import shlex
import shutil
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fit_material.fitter.command_line.common_options import Quiet, output_folder
from fit_material.fitter.command_line.output import complain, say
from fit_material.fitter.command_line.progress_bar import progress_bar
from fit_material.fitter.command_line.signature import options_said, with_parameters_of
from fit_material.fitter.commands.fit import DONE, NO_MATERIAL, chosen
from fit_material.fitter.options.progress import Progress
from fit_material.renderer.errors.input_error import InputError

if TYPE_CHECKING:
    from fit_material.fitter.batch.batch import Asked, Batch, Workers
    from fit_material.fitter.batch.scene_list import Listed
    from fit_material.fitter.batch.workers.scheduler import Scheduler

LISTS = (
    "Text files with a scene file a line, and options of fit behind it; folders, whose every scene.toml is fitted;"
    " scene files. Paths in a list are relative to it; * and ** match; # begins a comment; - is standard input."
)
SCHEDULER = (
    "Fit by the workers of this Dask scheduler, such as tls://10.0.0.1:8786. They need the same version of"
    " fit-material, and the same files under the same paths, results included. Described in docs/many-scenes.md."
)
CA_FILE = "Certificates that know the scheduler, as --tls-ca-file of dask scheduler."
CERT = "Certificate that is shown to the scheduler, as --tls-cert of dask worker."
KEY = "Private key of that certificate; may be in the same file."
INSECURE = "Take a scheduler without TLS: whoever reaches it can run code as you, here and on all workers."
CLUSTER = "A Dask cluster"


@with_parameters_of(chosen, panel="Options of fit, for every scene")
def batch(
    lists: Annotated[list[str], typer.Argument(metavar="LIST…", help=LISTS, show_default=False)],
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--out", metavar="PATH", parser=output_folder, help="Folder for a folder of each result, and summary."
        ),
    ],
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help=SCHEDULER, rich_help_panel=CLUSTER)] = None,
    tls_ca_file: Annotated[Path | None, typer.Option(help=CA_FILE, rich_help_panel=CLUSTER)] = None,
    tls_cert: Annotated[Path | None, typer.Option(help=CERT, rich_help_panel=CLUSTER)] = None,
    tls_key: Annotated[Path | None, typer.Option(help=KEY, rich_help_panel=CLUSTER)] = None,
    insecure: Annotated[bool, typer.Option("--insecure", help=INSECURE, rich_help_panel=CLUSTER)] = False,
    workers: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="Processes of this machine; as many as cores and memory allow if left out."),
    ] = None,
    cores: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="Of each worker; its share of the machine, or Dask's threads, if left out."),
    ] = None,
    quiet: Quiet = False,
    **options: Any,
) -> None:
    """Fit many scenes, on all cores or a Dask cluster; goes on where it was interrupted.

    What has a result of the same files and options is not fitted again. Exit code 0: every scene has a usable material;
    1: some have not, see the summary; 2: the list or an option is wrong, and nothing was fitted.
    """
    from fit_material.fitter.batch.scene_list import read_lists
    from fit_material.fitter.batch.workers.scheduler import scheduler_of

    if scheduler is not None and workers is not None:
        raise InputError("--workers", value=workers, expected="no number beside --scheduler, which has its own")
    elsewhere = scheduler_of(scheduler, tls_ca_file, tls_cert, tls_key, insecure)
    scenes = {name: _asked(listed, options) for name, listed in read_lists(lists).items()}
    with progress_bar(quiet) as progress:
        progress("starting", 0)
        from fit_material.fitter.batch.batch import Batch, alone_in

        with alone_in(out):
            found = Batch(scenes, out, shlex.join(["fit-material", *sys.argv[1:]]))
            reason = _run(found, functools.partial(_crew, elsewhere, workers, cores), progress)
    _print(found)
    if reason:
        complain(reason)
    raise typer.Exit(DONE if found.summary.all_usable else NO_MATERIAL)


def _asked(listed: Listed, options: Mapping[str, Any]) -> Asked:
    """A line's options take the place of the command's."""
    from fit_material.fitter.batch.batch import Asked
    from fit_material.fitter.pipeline.option_checks import require_consistent

    try:
        own = options_said(listed.words, chosen) if listed.words else {}
        how = chosen(**{**options, **own})
        require_consistent(how)
    except InputError as error:
        if not listed.words:
            raise
        reason = str(error).removeprefix(": expected ")
        raise InputError(
            listed.where, value=shlex.join(listed.words), expected=f"options that fit takes: {reason}"
        ) from None
    return Asked(listed.scene, how, listed.words)


def _run(batch: Batch, crew: Callable[[int], Workers], progress: Progress) -> str:
    """Fit the remaining scenes, and write the summary; a sentence on why some remain all the same, or ""."""
    from fit_material.fitter.batch.workers.pool import Lost

    try:
        left = batch.look_up(progress)
        if left:
            progress("starting workers", 0)
            batch.fit(left, crew(len(left)), progress)
    except Lost as error:
        batch.write_summary()
        return f"{error}; {_done(batch)}"
    except KeyboardInterrupt:
        complain(_done(batch))
        batch.write_summary()
        raise
    batch.write_summary()
    return ""


def _done(batch: Batch) -> str:
    done = sum(scene.fitted for scene in batch.known.values())
    return f"{done} of {len(batch.known)} scenes are done and kept; the same command goes on with the others"


def _crew(scheduler: Scheduler | None, workers: int | None, cores: int | None, scenes: int) -> Workers:
    """For so many scenes."""
    from fit_material.fitter.batch.batch import Workers
    from fit_material.fitter.batch.workers.pool import local_fits, usual_workers
    from fit_material.renderer.compute import threads

    if scheduler is not None:
        from fit_material.fitter.batch.workers.cluster import cluster_fits

        return Workers(functools.partial(cluster_fits, scheduler), cores, f"the workers of {scheduler.address}")
    count = workers or usual_workers(scenes, cores or 1)
    share = cores or max(1, threads.cores() // count)
    where = f"{count} worker{'s' if count > 1 else ''} of {share} core{'s' if share > 1 else ''}"
    return Workers(functools.partial(local_fits, count), share, where)


def _print(batch: Batch) -> None:
    from fit_material.fitter.batch.table import terminal_table

    say(terminal_table(batch.summary, shutil.get_terminal_size().columns if sys.stdout.isatty() else None))
    say(f"summary: {batch.out / 'summary.html'}")
