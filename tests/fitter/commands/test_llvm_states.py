"""Each command ends as documented whatever LLVM this machine has; `.ci/run` brings it into four states.

`tools/with_llvm.sh` makes the states: no LLVM, one alone that cannot compile our kernels, one that can, a wrong path.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fit_material.renderer.backends import llvm
from tests.support.paths import SOURCE

pytestmark = [pytest.mark.dr_jit, pytest.mark.slow]  # slow for all but `make test-llvm`

METAL = ("--pixels", "400", "--samples", "256", "--type", "metal")


def run(*arguments: str | Path, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """As a user would, in a process that has to find its compiler itself."""
    undecided = {name: value for name, value in os.environ.items() if name not in (llvm.LIBRARY, llvm.SWITCH)}
    command = [sys.executable, "-m", "fit_material", *map(str, arguments)]
    undecided |= {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(SOURCE)}
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env=undecided | environment)


def test_commands_end_as_documented(gold_scene, tmp_path):
    fitted = run("fit", gold_scene, "-o", "result", *METAL, cwd=tmp_path)
    assert fitted.returncode == 0, fitted.stderr
    result = json.loads((tmp_path / "result" / "result.json").read_text("utf-8"))
    assert result["status"] == "converged"
    # 40² pixels of some noise, few samples: F0 to a few per cent at worst; gold's red is 0.9584 (docs/accuracy.md)
    assert result["materials"][0]["f0"][0] == pytest.approx(0.9584, abs=0.05)
    for arguments in (
        ("check", gold_scene, "--json"),
        ("synth", "--metal", "Au", "--alpha", "0.2", "--size", "16", "--spp", "4", "--views", "1", "-o", "synth"),
    ):
        done = run(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        if "--json" in arguments:
            json.loads(done.stdout)


def test_a_batch_ends_as_documented(gold_scene, tmp_path):
    done = run("batch", gold_scene, "-o", "batch", "--workers", "1", *METAL, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "batch").glob("*/result.json"))) == 1


def test_a_frontier_ends_as_documented(gold_scene, tmp_path):
    few = ("--rungs", "viewer,preview-128-1500", "--repeats", "1", "--type", "matte")
    done = run("frontier", gold_scene, "-o", "frontier", *few, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "failed" not in done.stdout


def test_no_command_lets_the_compiler_speak(gold_scene, tmp_path):
    """At most two sentences, which are ours: on a path that is no library, and on the lack of any."""
    done = run("plan", gold_scene, "--json", cwd=tmp_path, DRJIT_LIBLLVM_PATH=str(gold_scene))
    first, *others = done.stderr.splitlines()
    assert done.returncode == 0
    assert json.loads(done.stdout)["effects"]
    assert first.startswith(
        f"fit-material: DRJIT_LIBLLVM_PATH: is {gold_scene}, expected an LLVM library that compiles"
    )
    assert len(others) <= 1
    assert all("path tracing and light tables take several times as long without" in line for line in others)
