"""`fit-material doctor`: what the program needs, whether this machine has it, and remedies."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer

from fit_material.fitter.command_line.output import say

WELL, LACKING = 0, 1  # exit codes


def doctor(as_json: Annotated[bool, typer.Option("--json", help="Print JSON: ok, and every check.")] = False) -> None:
    """Check what this machine has: Python, torch, Dr.Jit, LLVM, OpenGL, cores, memory, disk."""
    from fit_material.fitter.selftest.machine import checks

    found = []
    for check in checks():
        found.append(check)
        if not as_json:
            mark = "ok" if check.ok else "missing" if check.needed else "without"
            say(f"{mark:8}{check.name:14}{check.found}{f'; remedy: {check.remedy}' if check.remedy else ''}")
    ok = all(each.ok for each in found if each.needed)
    if as_json:
        say(json.dumps({"ok": ok, "checks": [asdict(each) for each in found]}, ensure_ascii=False, indent=2))
    raise typer.Exit(WELL if ok else LACKING)
