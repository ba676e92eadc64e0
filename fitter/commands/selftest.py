"""`fit-material selftest`: the hard cases on this machine; heavy imports are late."""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from importlib.metadata import version
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fit_material.fitter.command_line.common_options import Device, Quiet
from fit_material.fitter.command_line.output import say
from fit_material.fitter.command_line.progress_bar import progress_bar

if TYPE_CHECKING:
    from fit_material.fitter.selftest.table import Verdict

HOLDS, BROKEN = 0, 1  # exit codes
PACKAGES = ("fit-material", "torch", "jax", "optimistix", "numpy", "OpenEXR")


def selftest(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: machine, versions, every row.")] = False,
    device: Device = "cpu",
    quiet: Quiet = False,
) -> None:
    """Check on this machine what breaks shading models and fits elsewhere: NaN, mirrors, suns, empty photographs."""
    begun = time.perf_counter()
    with progress_bar(quiet) as progress:
        progress("starting", 0)
        from fit_material.fitter.selftest.table import verdicts
        from fit_material.renderer.compute.devices import torch_device

        found = verdicts(torch_device(device), lambda verdict, share: progress("hard cases", share))
    seconds = time.perf_counter() - begun
    if as_json:
        say(json.dumps(_record(found, seconds), ensure_ascii=False, allow_nan=False, indent=2))
    else:
        _print(found, seconds)
    raise typer.Exit(HOLDS if all(each.holds for each in found) else BROKEN)


def _print(found: list[Verdict], seconds: float) -> None:
    for topic in dict.fromkeys(each.topic for each in found):
        own = [each for each in found if each.topic == topic]
        held, rows = sum(each.holds for each in own), len({each.row.name for each in own})
        say(f"{topic:12}{rows:4} rows   {held} of {len(own)} runs hold   {sum(each.seconds for each in own):5.1f} s")
        for each in own:
            for sentence in each.broken:
                say(f"  {each.row.name}, {each.numbers}: {sentence}")
    rows, held = len({each.row.name for each in found}), sum(each.holds for each in found)
    versions = ", ".join(f"{name} {number}" for name, number in _versions().items())
    say(f"{held} of {len(found)} runs of {rows} rows hold, in {seconds:.0f} s: {_machine()}, {versions}")


def _record(found: list[Verdict], seconds: float) -> dict[str, Any]:
    rows = [
        {
            "topic": each.topic,
            "name": each.row.name,
            "numbers": str(each.numbers),
            "holds": each.holds,
            "broken": list(each.broken),
            "seconds": round(each.seconds, 3),
        }
        for each in found
    ]
    return {
        "holds": all(each.holds for each in found),
        "machine": _machine(),
        "versions": _versions(),
        "seconds": round(seconds, 1),
        "rows": rows,
    }


def _machine() -> str:
    return f"{platform.machine()}, {os.cpu_count()} cores, {sys.platform}, Python {platform.python_version()}"


def _versions() -> dict[str, str]:
    """Of the packages that numbers depend on."""
    return {name: version(name) for name in PACKAGES}
