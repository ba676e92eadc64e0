"""Help, version and a slip in the arguments are answered before anything heavy is imported."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import version

import pytest

HEAVY = {"torch", "jax", "mitsuba", "drjit", "numpy", "scipy", "matplotlib", "kornia"}
COMMANDS = ("fit", "check", "batch", "frontier", "synth", "demo", "export", "view")
PLENTY = 1000  # modules; typer and rich bring some 400, torch alone over 1500


def run(*arguments: str) -> tuple[subprocess.CompletedProcess[str], set[str]]:
    """Run the command in a fresh interpreter: how it ended, and every module that it had imported by then."""
    code = f"import sys; sys.argv[1:] = {list(arguments)}; from fit_material.fitter.commands.app import main; main()"
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "COLUMNS": "200"},
    )
    lines = done.stderr.splitlines()
    modules = {line.rpartition("|")[2].strip() for line in lines if line.startswith("import time:")}
    done.stderr = "\n".join(line for line in lines if not line.startswith("import time:"))
    return done, modules


def heavy(modules: set[str]) -> set[str]:
    return {name.partition(".")[0] for name in modules} & HEAVY


def test_the_list_of_modules_is_whole():
    _, modules = run("export", "no-such-result.json", "-o", "nowhere")
    assert {"typer", "fit_material.fitter.commands.app", "fit_material.fitter.result.schema", "pydantic"} <= modules


def test_version():
    done, modules = run("--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"fit-material {version('fit-material')}\n"
    assert not heavy(modules)
    assert len(modules) < PLENTY


@pytest.mark.parametrize("command", [(), *((name,) for name in COMMANDS)])
def test_help(command):
    done, modules = run(*command, "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert "Usage: " in done.stdout
    assert not heavy(modules)
    assert len(modules) < PLENTY


def test_help_names_every_command():
    done, _ = run("--help")
    assert all(name in done.stdout for name in COMMANDS)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("synth", "--metal", "Unobtainium", "-o", "x"), "Unobtainium"),
        (("synth", "-o", "x"), "expected --metal NAME, --n and --k, or --color"),
        (("fit", "scene.toml", "-o", "x", "--type", "wooden"), "'wooden' is not one of 'auto', 'metal'"),
    ],
)
def test_slips_are_answered_at_once(arguments, sentence, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done, modules = run(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("fit-material: ")
    assert sentence in done.stderr
    assert not heavy(modules)
    assert not list(tmp_path.iterdir())
