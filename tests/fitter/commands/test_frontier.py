"""`fit-material frontier` as a user runs it: files, resuming, Ctrl-C, slips."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fit_material.fitter.commands import app
from fit_material.fitter.frontier import compare
from fit_material.fitter.frontier.runs import Run
from fit_material.fitter.result.schema import Time
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

COMMAND = [sys.executable, "-m", "fit_material", "frontier"]
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1"}
CSV_AND_SO_ON = ("csv", "json", "png", "html")
RUNGS = ("--rungs", "viewer,preview-128-1500", "--type", "metal", "--repeats", "1")


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    gold = metal("Au")
    options = SynthOptions(TrueMetal(gold.n, gold.k, alpha=0.25), size=32, spp=64, views=1)
    return synthesise(options, tmp_path_factory.mktemp("photographs"))


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=ENVIRONMENT)


@pytest.mark.slow  # two fits, each with a start-up of its own
def test_the_whole_command_and_again_for_nothing(scene, tmp_path):
    done = run(scene, "-o", tmp_path, *RUNGS)
    assert (done.returncode, done.stderr) == (0, "")
    assert "Errors are against the truth" in done.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"runs", *(f"frontier.{end}" for end in CSV_AND_SO_ON)}
    rows = list(csv.DictReader((tmp_path / "frontier.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["rung"] for row in rows] == ["viewer", "preview-128-1500"]
    assert all(0 < float(row["seconds_total_median"]) < float(row["seconds_command_median"]) for row in rows)
    assert all(100e6 < float(row["peak_bytes_median"]) < 4e9 for row in rows)
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()}
    assert len(kept) == 2
    again = run(scene, "-o", tmp_path, *RUNGS)
    assert again.stdout == done.stdout
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()} == kept


@pytest.mark.slow  # a fit that is stopped, and one more
def test_ctrl_c_keeps_what_is_done(scene, tmp_path):
    with subprocess.Popen(
        [*COMMAND, scene, "-o", tmp_path, *RUNGS], env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        runs = tmp_path / "runs"
        while not list(runs.glob("*.json")):
            assert process.poll() is None
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate()
    assert process.returncode == 130
    assert said.decode().startswith("fit-material: interrupted")
    assert [json.loads(path.read_text())["rung"] for path in runs.iterdir()] == ["viewer"]


def naming(path: Path) -> list[int]:
    """Processes with that path in their command line."""
    lines = {int(each.name): each / "cmdline" for each in Path("/proc").iterdir() if each.name.isdecimal()}
    found = []
    for process, line in lines.items():
        with suppress(OSError):  # it has ended meanwhile
            found += [process] if str(path).encode() in line.read_bytes() else []
    return found


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="processes are looked up in /proc")
def test_sigterm_ends_the_fit_and_sweeps_its_folder(scene, tmp_path):
    """Sent twice, as `timeout` does; what an earlier run has left is not this one's."""
    runs = tmp_path / "runs"
    (runs / ".unfinished-earlier").mkdir(parents=True)
    command = [*COMMAND, scene, "-o", tmp_path, *RUNGS]
    with subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        while not naming(runs):  # the fit's -o
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate()
    left = naming(runs)
    for each in left:
        os.kill(each, signal.SIGKILL)
    assert left == []
    assert (process.returncode, said.decode().partition(";")[0]) == (130, "fit-material: interrupted")
    assert [path.name for path in runs.iterdir()] == [".unfinished-earlier"]


def test_wrong_input_of_a_fit_is_told_in_its_own_words(scene, tmp_path):
    spoilt = scene.with_name("spoilt.toml")
    spoilt.write_text(scene.read_text().replace("exposure = 1.0", "exposure = -1.0"))
    done = run(spoilt, "-o", tmp_path, *RUNGS)
    assert done.returncode == 2
    assert done.stderr.startswith(f"fit-material: {spoilt}: photographs[0].exposure: is -1.0, expected a number from ")
    assert done.stderr.count("\n") == 1


def test_a_truth_of_another_scene_is_told_before_any_fit(scene, tmp_path):
    other = shutil.copytree(scene.parent, tmp_path / "other") / "scene.toml"
    truth = other.with_name("truth.json")
    truth.write_text(truth.read_text().replace('"name": "default"', '"name": "lid"'))
    done = run(other, "-o", tmp_path / "new", *RUNGS)
    sentence = f"materials[].name: is lid, expected the name of a material of {other}: default; or no truth.json there"
    assert (done.returncode, done.stderr) == (2, f"fit-material: {truth}: {sentence}\n")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(("ended", "code"), [(0, 1), (1, 1), (2, 0)])
def test_fewer_than_two_fits_are_no_comparison(scene, tmp_path, monkeypatch, ended, code):
    """Runs that die, as by a compiler that aborts, are told as failed, and by the exit code."""

    def died(experiment, rungs, repeats, progress):
        fine = {"status": "converged", "message": "", "picture": 0.1}
        lost = {"status": "failed", "message": "LLVM ERROR: Cannot select"}
        time_ = Time(load=1, prepare=1, solve=1, report=1, total=4)
        return [
            Run(
                rung=rung.name, options=(), seed=0, command=1, peak=1, **(fine | {"time": time_} if i < ended else lost)
            )
            for i, rung in enumerate(rungs)
        ]

    monkeypatch.setattr(compare, "all_runs", died)
    done = CliRunner().invoke(app.app, ["frontier", str(scene), "-o", str(tmp_path), *RUNGS])
    assert done.exit_code == code, done.output
    assert done.output.count("failed: LLVM ERROR: Cannot select") == 2 - ended


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--repeats", "0"), "--repeats: is 0, expected a whole number from 1 to 100"),
        (("--rungs", "viewer"), "--rungs: is viewer, expected two rungs at least, to compare"),
    ],
)
def test_slips_are_told_at_once(arguments, sentence, tmp_path):
    done = run("nowhere.toml", "-o", tmp_path / "new", *arguments)
    assert (done.returncode, done.stderr) == (2, f"fit-material: {sentence}\n")
    assert not (tmp_path / "new").exists()
