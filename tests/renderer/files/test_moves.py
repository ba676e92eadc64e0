"""Files that replace others together do so though their process is killed in between."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.renderer.files.moves import JOURNAL, finish
from fit_material.renderer.files.replaceable import contents
from fit_material.renderer.files.unfinished import sweep

NAMES = ("a", "b", "c", "result.json")
KILLED = """
import os, signal, sys
from pathlib import Path
replace, out, left = os.replace, Path(sys.argv[1]), [int(sys.argv[2])]
def dying(source, target):
    if Path(target).parent == out:
        if not left[0]:
            os.kill(os.getpid(), signal.SIGKILL)
        left[0] -= 1
    replace(source, target)
os.replace = dying
"""
MOVE = """
from fit_material.renderer.files.atomic import replaced_together
with replaced_together(sys.argv[1]) as folder:
    for name in ("a", "b", "c", "result.json"):
        (folder / name).write_text("new " + name)
"""
FIT = """
from fit_material.fitter.commands.app import program
options = "--type metal --pixels 100 --samples 32 -q --seed 1".split()
sys.argv = ["fit-material", "fit", sys.argv[3], "-o", str(out), *options]
program()
"""


def killed(code: str, out: Path, moves: int, *arguments: str) -> None:
    """The code's process dies when it has moved so many files into `out`."""
    command = [sys.executable, "-c", KILLED + code, str(out), str(moves), *arguments]
    assert subprocess.run(command, check=False, env={**os.environ, "OMP_NUM_THREADS": "1"}).returncode == -9


@pytest.mark.parametrize("moved", range(4))
def test_the_next_one_moves_the_rest(tmp_path, moved):
    for name in ("a", "b"):
        (tmp_path / name).write_text("old")
    killed(MOVE, tmp_path, moved)
    assert [(tmp_path / name).exists() for name in NAMES] == [True, True, moved > 2, False]
    sweep(tmp_path)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {name: f"new {name}" for name in NAMES}


def test_what_somebody_wrote_meanwhile_stays(tmp_path):
    (tmp_path / "b").write_text("old")
    killed(MOVE, tmp_path, 1)
    (tmp_path / "b").write_text("mine")
    (tmp_path / "c").symlink_to("nowhere")
    sweep(tmp_path)
    assert (tmp_path / "b").read_text() == "mine"
    assert (tmp_path / "c").is_symlink()
    assert (tmp_path / "result.json").read_text() == "new result.json"


@pytest.mark.parametrize("name", ["../b", "sub/../../b"])
def test_a_journal_leads_nowhere_else(tmp_path, name):
    """Somebody's archive may hold an unfinished folder, too."""
    source, directory = tmp_path / "source" / "x" / "y", tmp_path / "out" / "x"
    for folder in (source, directory):
        (folder / "sub").mkdir(parents=True)
    (source.parent / "b").write_text("theirs")
    (source / JOURNAL).write_text(json.dumps({name: None}))
    finish(source, directory)
    assert not (tmp_path / "out" / "b").exists()


@pytest.mark.parametrize("journal", ["", "[]", "3", "\x00", '{"b": null', "[" * 100000])
def test_a_damaged_journal_moves_nothing(tmp_path, journal):
    source = tmp_path / "source"
    source.mkdir()
    (source / "b").write_text("new")
    (source / JOURNAL).write_text(journal)
    finish(source, tmp_path)
    assert not (tmp_path / "b").exists()


@pytest.mark.slow
def test_a_folder_in_which_a_fit_was_killed_is_fitted_into_again(gold_photographs, tmp_path):
    options = FitOptions(replace(PRESETS["preview"], pixels=100, samples=32), type="metal")
    out, scene = tmp_path / "out", gold_photographs / "scene.toml"
    fit_scene(scene, out, options)
    before = contents(out)
    killed(FIT, out, 2, str(scene))
    assert contents(out) != before
    result = fit_scene(scene, out, options)
    assert result.outputs is not None
    assert {file.path: file.sha256 for file in result.outputs}.items() <= contents(out).items()
    assert not list(out.glob(".*"))
