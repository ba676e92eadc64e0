"""`fit-material batch` as a user runs it: three processes, one of them killed, one scene wrong, one run interrupted."""

from __future__ import annotations

import inspect
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from glob import glob
from pathlib import Path

import pytest

from fit_material.fitter.batch.batch import Asked, Batch
from fit_material.fitter.batch.workers import pool
from fit_material.fitter.command_line.signature import options_said
from fit_material.fitter.commands import app
from fit_material.fitter.commands.fit import chosen
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.result.schema import read_result
from fit_material.renderer.compute import threads
from fit_material.renderer.materials.ground_truth import TrueMatte
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

COMMAND = [sys.executable, "-m", "fit_material", "batch"]
QUICK = ("--fidelity", "preview", "--pixels", "300", "--samples", "64")
FILES = {"result.json", "report.html", "comparison.png", "sphere.mtl", "sphere.thesis.mtl"}  # what `fit` writes
GOOD = tuple(f"clay-{index}" for index in range(7))

needs_proc = pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="processes are looked up in /proc")


@pytest.fixture(scope="module")
def clay(tmp_path_factory) -> Path:
    """A small scene of a matte ball."""
    options = SynthOptions(TrueMatte((0.5, 0.3, 0.2)), size=32, spp=4096, views=2)
    return synthesise(options, tmp_path_factory.mktemp("clay"))


def command_line(clay: Path, folder: Path) -> list[str]:
    """Eight scenes and their list, made in `folder`: the same ball seven times, and one that no fit takes."""
    for name in (*GOOD, "wrong"):
        shutil.copytree(clay.parent, folder / name)
    wrong = folder / "wrong" / "scene.toml"
    wrong.write_text(wrong.read_text().replace("exposure = 1.0", "exposure = -1.0"))
    (folder / "list.txt").write_text("# balls\nclay-*/scene.toml --type matte\nwrong\n")
    return [*COMMAND, str(folder / "list.txt"), "-o", str(folder / "out"), "--workers", "3", *QUICK]


def taken_over(out: Path) -> list[str]:
    """The names in the log of fits that ended."""
    log = out / "fits.jsonl"
    return [json.loads(line)["name"] for line in log.read_text().splitlines()] if log.exists() else []


def under_way(out: Path) -> set[tuple[str, int]]:
    """Name and process of fits that have begun and not ended; `Path.glob` fails where a folder goes meanwhile."""
    folders = map(Path, glob(str(out / ".unfinished-*" / "*" / "*")))
    begun = [folder for folder in folders if not (folder / "batch.json").exists()]
    return {(each.parent.name, int(each.name.partition("-")[0])) for each in begun if each.parent.name != "wrong"}


def wait_until(true: Callable[[], object], process: subprocess.Popen[bytes]) -> None:
    while not true():
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)


def begun(command: list[str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


@pytest.fixture(scope="module")
def story(clay, tmp_path_factory) -> dict:
    """Three processes fit all scenes; one of them is killed at its work as soon as a result is there."""
    folder = tmp_path_factory.mktemp("batch")
    command, out = command_line(clay, folder), folder / "out"
    with begun(command) as process:
        wait_until(lambda: taken_over(out), process)
        before = under_way(out)
        wait_until(lambda: under_way(out) - before, process)  # one that has just begun will not end meanwhile
        killed, worker = (under_way(out) - before).pop()
        os.kill(worker, signal.SIGKILL)
        told, errors = process.communicate()
    seen = {"killed": killed, "code": process.returncode, "told": told.decode(), "errors": errors.decode()}
    return {"folder": folder, "out": out, **seen}


@needs_proc
def test_every_scene_is_fitted_and_none_twice_though_a_process_was_killed(story):
    assert sorted(taken_over(story["out"])) == sorted(GOOD)
    summary = json.loads((story["out"] / "summary.json").read_text())
    starts = {scene["name"]: scene["starts"] for scene in summary["scenes"] if scene["name"] in GOOD}
    assert starts == {name: 2 if name == story["killed"] else 1 for name in GOOD}
    for name in GOOD:
        assert {path.name for path in (story["out"] / name).iterdir()} == FILES | {"batch.json"}
    assert not list(story["out"].glob(".*"))


def test_the_results_are_those_of_fit(story, clay, tmp_path):
    """Bit by bit: whatever a process had fitted before, and however often it was begun."""
    alone = fit_scene(clay, tmp_path / "alone", chosen_by(*QUICK, "--type", "matte"))
    for name in GOOD:
        found = read_result(story["out"] / name / "result.json")
        assert (found.status, found.materials) == (alone.status, alone.materials), name


def chosen_by(*words: str) -> FitOptions:
    usual = {name: each.default for name, each in inspect.signature(chosen).parameters.items()}
    return chosen(**{**usual, **options_said(words, chosen)})


def test_a_wrong_scene_is_told_and_the_rest_goes_on(story):
    assert (story["code"], story["errors"]) == (1, "")
    scene = story["folder"] / "wrong" / "scene.toml"
    expected = f"{scene}: photographs[0].exposure: is -1.0, expected a number from "
    wrong = json.loads((story["out"] / "summary.json").read_text())["scenes"][-1]
    assert (wrong["name"], wrong["status"]) == ("wrong", "wrong_input")
    assert wrong["message"].startswith(expected)
    assert f"wrong: wrong input: {wrong['message']}" in story["told"].splitlines()
    assert not (story["out"] / "wrong").exists()


def test_the_page_leads_to_every_report_and_loads_nothing(story):
    page = (story["out"] / "summary.html").read_text()
    assert [name for name in GOOD if f'href="{name}/report.html"' not in page] == []
    assert page.count("begun 2 times") == 1
    assert "<script" not in page
    assert "src=" not in page


def left_to_fit(folder: Path, *changes: str) -> list[str]:
    how = chosen_by(*QUICK, "--type", "matte", *changes)
    asked = {name: Asked(folder / name / "scene.toml", how, ()) for name in GOOD}
    return Batch(asked, folder / "out", "").look_up(lambda stage, share: None)


def test_other_options_are_another_result(story):
    assert left_to_fit(story["folder"]) == []
    assert left_to_fit(story["folder"], "--seed", "1") == list(GOOD)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda out, scene: (out / "report.html").unlink(),
        lambda out, scene: (out / "sphere.mtl").write_text("newmtl other\n"),
        lambda out, scene: (out / "batch.json").write_text("{"),
        lambda out, scene: scene.write_text(scene.read_text() + "\n# changed\n"),
        lambda out, scene: swap(scene.with_name("view_0.exr"), scene.with_name("view_1.exr")),
        lambda out, scene: scene.unlink(),
    ],
    ids=["report gone", "file changed", "note damaged", "scene changed", "photographs swapped", "scene gone"],
)
def test_what_is_damaged_or_changed_is_fitted_again(story, spoil, tmp_path):
    moved = shutil.copytree(story["folder"], tmp_path / "moved")
    assert left_to_fit(moved) == []  # where everything has moved, nothing has changed
    spoil(moved / "out" / "clay-3", moved / "clay-3" / "scene.toml")
    assert left_to_fit(moved) == ["clay-3"]


def swap(one: Path, other: Path) -> None:
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)


def test_again_for_nothing(story, monkeypatch, capsys, tmp_path):
    """Without the one that is wrong all are usable, and nobody is called to fit."""
    folder = shutil.copytree(story["folder"], tmp_path / "again")
    shutil.rmtree(folder / "wrong")
    before = {path: path.stat().st_mtime_ns for path in (folder / "out").glob("*/*")}
    monkeypatch.setattr(pool, "local_fits", None)
    assert run(monkeypatch, "batch", folder, "-o", folder / "out", *QUICK, "--type", "matte") == 0
    told = capsys.readouterr().out
    assert "7 scenes: 7 converged; 7 of them fitted before. " in told
    assert told.endswith(f"by nobody: all had been fitted before.\nsummary: {folder / 'out' / 'summary.html'}\n")
    assert {path: path.stat().st_mtime_ns for path in (folder / "out").glob("*/*")} == before
    assert (folder / "out" / "summary.html").read_text().count("<small>fitted before</small>") == len(GOOD)


@needs_proc
@pytest.mark.slow  # two runs, of which the second is not needed elsewhere
def test_sigterm_keeps_what_is_done_and_the_same_command_goes_on(clay, tmp_path):
    """And no process stays behind."""
    command, out = command_line(clay, tmp_path), tmp_path / "out"
    with begun(command) as first:
        wait_until(lambda: len(taken_over(out)) >= 1 and under_way(out), first)
        workers = {process for _, process in under_way(out)}
        first.send_signal(signal.SIGTERM)
        _, said = first.communicate()
    taken, summary = taken_over(out), json.loads((out / "summary.json").read_text())
    assert first.returncode == 130
    done, interrupted = said.decode().splitlines()
    expected = f"fit-material: {len(taken)} of 8 scenes are done and kept; the same command goes on with the others"
    assert done == expected
    assert interrupted.startswith("fit-material: interrupted")
    assert not list(out.glob(".*"))
    assert not any(is_alive(process) for process in workers)
    assert 1 <= len(taken) < len(GOOD)
    fitted = [scene["name"] for scene in summary["scenes"] if scene["seconds"] is not None]
    assert sorted(fitted) == sorted(taken)
    assert summary["counts"]["pending"] >= 1
    assert subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode == 1  # of the wrong one
    assert sorted(taken_over(out)) == sorted(GOOD)
    summary = json.loads((out / "summary.json").read_text())
    assert sorted(scene["name"] for scene in summary["scenes"] if scene["kept"]) == sorted(taken)


@needs_proc
@pytest.mark.slow  # a process that is begun three times
def test_a_scene_that_ends_its_process_each_time_is_given_up(clay, tmp_path):
    """And costs the others nothing."""
    for name in ("a", "b", "fatal"):
        shutil.copytree(clay.parent, tmp_path / name)
    out = tmp_path / "out"
    killed = set()
    with begun([*COMMAND, str(tmp_path), "-o", str(out), "--type", "matte", "--workers", "2", *QUICK]) as process:
        while process.poll() is None:
            for _, number in (each for each in under_way(out) if each[0] == "fatal" and each[1] not in killed):
                os.kill(number, signal.SIGKILL)
                killed.add(number)
            time.sleep(0.01)
        process.communicate()
    assert (process.returncode, len(killed)) == (1, 3)
    states = {scene["name"]: scene for scene in json.loads((out / "summary.json").read_text())["scenes"]}
    assert [states[name]["status"] for name in ("a", "b", "fatal")] == ["converged", "converged", "failed"]
    expected = "the process that fitted it died each time, of SIGKILL, perhaps out of memory; tried 3 times"
    assert states["fatal"]["message"] == expected
    assert sorted(taken_over(out)) == ["a", "b"]


def is_alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def run(monkeypatch, *arguments: object) -> int:
    """The command in this process."""
    monkeypatch.setattr(sys, "argv", ["fit-material", *map(str, arguments)])
    monkeypatch.setattr(threads, "_limit", [])
    with pytest.raises(SystemExit) as ended:
        app.main()
    return int(ended.value.code or 0)


def test_one_batch_at_a_time_in_a_folder(clay, tmp_path, monkeypatch, capsys):
    from fit_material.fitter.batch.batch import alone_in

    with alone_in(tmp_path):
        assert run(monkeypatch, "batch", clay, "-o", tmp_path) == 2
    expected = "expected a folder that no other batch writes to at the same time"
    assert capsys.readouterr().err == f"fit-material: -o: is {tmp_path}, {expected}\n"
