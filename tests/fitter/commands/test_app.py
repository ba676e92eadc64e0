"""The command line as a user meets it: exit codes, what is printed where, progress, interruption."""

from __future__ import annotations

import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import tinyobjloader

from fit_material.fitter.commands import app
from fit_material.fitter.commands.export import _stem
from fit_material.fitter.result import formatting
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from tests.fitter.result.test_schema import result
from tests.support.paths import SOURCE

COMMAND = [sys.executable, "-m", "fit_material"]
# a program beside a test must not take all cores with tensors of a few thousand numbers
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "TERM": "xterm", "COLUMNS": "100"}
FILES = {"result.json", "report.html", "comparison.png", "sphere.mtl", "sphere.thesis.mtl"}

# DESIGN.md's contract of result.json, written out once more
TOP = "format status message materials quality exposure model effects time inputs outputs"
PARAMETERS = "n k f0 alpha roughness color reflectance"
MATERIAL = f"name type {PARAMETERS} stderr interval95 determined nearest from_prior correlation"
QUALITY = "rms_relative psnr ssim"
MODEL = "fidelity reflectance lobe samples pixels dtype levels environment_size"
TIME = "load prepare solve report total"
EFFECTS = """reflection blur horizon light-reflection diffuse-irradiance energy-guard normal-map color-map
    ambient-occlusion double-bounce captured-neighbours depth-scaled-blur self-visibility interreflection
    exact-fresnel pixel-footprint"""


@pytest.fixture(scope="module")
def done(gold_photographs, tmp_path_factory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """The main job, run once as a user runs it, and its folder."""
    out = tmp_path_factory.mktemp("done") / "new" / "folder"
    return run("fit", gold_photographs / "scene.toml", "-o", out), out


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, check=False, env=ENVIRONMENT
    )


def strictly_parsed(path: Path) -> dict:
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(path.read_text("utf-8"), parse_constant=refuse)


# What comes out


def test_exit_code_and_streams(done):
    ended, out = done
    assert (ended.returncode, ended.stderr) == (0, "")
    lines = ended.stdout.splitlines()
    assert lines[0] == "default: metal, most like gold"
    assert [line.split()[0] for line in lines[1:6]] == ["n", "k", "f0", "alpha", "roughness"]
    assert lines[-1] == f"report: {out / 'report.html'}"
    assert {path.name for path in out.iterdir()} == FILES


def test_result_is_strict_json_with_every_key_of_the_contract(done, gold_photographs):
    result = strictly_parsed(done[1] / "result.json")
    assert list(result) == TOP.split()
    assert (result["format"], result["status"]) == (1, "converged")
    (material,) = result["materials"]
    assert set(material) == set(MATERIAL.split())
    assert (material["name"], material["type"]) == ("default", "metal")
    for part in ("stderr", "interval95", "determined"):
        assert set(material[part]) == set(PARAMETERS.split())
    for key in ("n", "k", "f0"):
        assert [len(material[key]), len(material["stderr"][key]), len(material["determined"][key])] == [3, 3, 3]
        assert all(
            low <= value <= high for value, (low, high) in zip(material[key], material["interval95"][key], strict=True)
        )
    assert material["color"] is None
    assert material["reflectance"] is None
    assert set(material["nearest"][0]) == {"name", "distance"}
    assert set(result["quality"]["overall"]) == set(QUALITY.split())
    assert [set(each) for each in result["quality"]["photographs"]] == [{"name", *QUALITY.split()}] * 2
    assert result["exposure"] == [1.0, 1.0]
    assert set(result["model"]) == set(MODEL.split())
    assert result["model"]["fidelity"] == "standard"
    assert [effect["name"] for effect in result["effects"]] == EFFECTS.split()
    assert all(set(effect) == {"name", "on", "why"} for effect in result["effects"])
    assert set(result["time"]) == set(TIME.split())
    read = {Path(file["path"]).name for file in result["inputs"]}
    assert read == {"scene.toml", "environment.exr", "view_0.exr", "view_1.exr"}


def test_the_truth_is_within_the_stated_errors(done, gold_photographs):
    (found,) = strictly_parsed(done[1] / "result.json")["materials"]
    (truth,) = strictly_parsed(gold_photographs / "truth.json")["materials"]
    for value, true, error in zip(found["f0"], truth["f0"], found["stderr"]["f0"], strict=True):
        assert abs(value - true) < 4 * error + 0.005  # the margin of tests/fitter/pipeline/test_fit_scene.py
    assert abs(found["alpha"] - truth["alpha"]) < 4 * found["stderr"]["alpha"] + 0.01 * truth["alpha"]


def test_material_files_read_back(done, tmp_path):
    """By a reader that is not ours: the numbers are those of result.json, to nine digits."""
    (found,) = strictly_parsed(done[1] / "result.json")["materials"]
    for name in ("sphere.mtl", "sphere.thesis.mtl"):
        obj = done[1].with_name("read.obj")
        obj.write_text(f"mtllib folder/{name}\nusemtl default\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        reader = tinyobjloader.ObjReader()
        assert reader.ParseFromFile(str(obj))
        (material,) = reader.GetMaterials()
        assert material.name == "default"
    text = (done[1] / "sphere.thesis.mtl").read_text()
    assert all(f"{value:.9g}" in text for value in (*found["n"], *found["k"], found["roughness"]))


def test_the_report_loads_nothing(done):
    class References(HTMLParser):
        def handle_starttag(self, tag, attrs):
            assert tag not in ("script", "link", "iframe", "object")
            for key, value in attrs:
                if key in ("src", "href", "xlink:href", "srcset", "data"):
                    assert value.startswith(("#", "data:image/png;base64,"))

    html = (done[1] / "report.html").read_text("utf-8")
    References().feed(html)
    assert not re.search(r"https?://|@import|url\((?!#)", html)
    assert (
        html.count("data:image/png;base64,") == 24
    )  # of two views fit and outliers, of four effects strips; three each


def test_export_writes_the_same_material_files(done, tmp_path):
    ended = run("export", done[1] / "result.json", "-o", tmp_path)
    assert (ended.returncode, ended.stderr) == (0, "")
    written = {Path(line) for line in ended.stdout.splitlines()}
    assert written == set(tmp_path.iterdir())
    assert {path.name for path in written} == {"sphere.mtl", "sphere.thesis.mtl"}
    originals = {(done[1] / name).read_bytes() for name in ("sphere.mtl", "sphere.thesis.mtl")}
    assert {path.read_bytes() for path in written} == originals


def test_numbers_are_printed_with_four_digits():
    assert formatting._with_error(0.000123456, 1.23456e-7) == "0.0001235 ± 1.235e-07"
    assert formatting._with_error(12345.6, None) == "1.235e+04 (not determined)"


@pytest.mark.parametrize(
    ("names", "stem"),
    [([], "folder"), (["a.b.thesis.mtl", "a.b.mtl"], "a.b"), (["a.thesis.mtl", "b.thesis.mtl"], "folder")],
)
def test_exported_files_are_called_as_the_fit_called_them(tmp_path, names, stem):
    (tmp_path / "folder").mkdir()
    for name in names:
        (tmp_path / "folder" / name).touch()
    assert _stem(tmp_path / "folder" / "result.json") == stem


def test_locales_without_our_letters():
    environment = {**ENVIRONMENT, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    for arguments, code in ((["fit", "--help"], 0), (["synth", "--metal", "±", "-o", "x"], 2)):
        ended = subprocess.run([*COMMAND, *arguments], capture_output=True, check=False, env=environment)
        assert ended.returncode == code
        assert b"internal error" not in ended.stderr
        assert (ended.stdout + ended.stderr).isascii()


@pytest.mark.parametrize("exported", [False, True])
def test_output_that_nobody_reads(exported, tmp_path):
    (tmp_path / "result.json").write_text(result().model_dump_json())
    arguments = ["export", tmp_path / "result.json", "-o", tmp_path / "out"] if exported else ["fit", "--help"]
    read, write = os.pipe()
    os.close(read)
    ended = subprocess.run(
        [*COMMAND, *map(str, arguments)], stdout=write, stderr=subprocess.PIPE, check=False, env=ENVIRONMENT
    )
    os.close(write)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert (tmp_path / "out").exists() == exported


@pytest.mark.parametrize("arguments", [("fit", "--help"), ("--version",), ("export",)])
def test_output_that_cannot_be_written(arguments, tmp_path):
    if arguments == ("export",):
        (tmp_path / "result.json").write_text(result().model_dump_json())
        arguments = ("export", tmp_path / "result.json", "-o", tmp_path / "out")
    environment = {**ENVIRONMENT, "PYTHONUNBUFFERED": ""}  # what typer prints itself is not kept by Python else
    with open("/dev/full", "wb") as full:
        ended = subprocess.run(
            [*COMMAND, *map(str, arguments)], stdout=full, stderr=subprocess.PIPE, check=False, env=environment
        )
    told = b"fit-material: standard output cannot be written (No space left on device)\n"
    assert (ended.returncode, ended.stderr) == (1, told)


def test_errors_that_cannot_be_written_keep_their_exit_code():
    with open("/dev/full", "wb") as full:
        ended = subprocess.run([*COMMAND, "nonsense"], stdout=full, stderr=full, check=False, env=ENVIRONMENT)
    assert ended.returncode == 2


def closed(streams: str, *arguments: object) -> subprocess.CompletedProcess[bytes]:
    """Run with some standard streams closed, as a shell's `>&- 2>&-` has them."""
    command = ["sh", "-c", f'exec "$@" {streams}', "sh", *COMMAND, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, check=False, env=ENVIRONMENT)


def test_closed_output_is_output_that_nobody_reads(gold_photographs, tmp_path):
    """`plan` reads EXR files, whose reader turns descriptor 1 away for a moment."""
    ended = closed(">&-", "plan", gold_photographs / "scene.toml", "--fidelity", "preview", "--type", "metal")
    assert (ended.returncode, ended.stderr) == (0, b"")


@pytest.mark.parametrize(
    "streams", [*(pytest.param(each, marks=pytest.mark.slow) for each in ("<&-", ">&-", "2>&-")), "<&- >&- 2>&-"]
)
def test_closed_streams_keep_the_exit_code_and_the_files(streams, tmp_path):
    (tmp_path / "result.json").write_text(result().model_dump_json())
    assert closed(streams, "export", tmp_path / "result.json", "-o", tmp_path / "out").returncode == 0
    assert all(b"fit-material:" not in path.read_bytes() for path in (tmp_path / "out").iterdir())
    assert closed(streams, "export", tmp_path / "nowhere.json", "-o", tmp_path / "new").returncode == 2
    assert closed(streams, "--help").returncode == 0


QUICK = ("--fidelity", "preview", "--samples", 64, "--pixels", 100, "--no-check")


@pytest.mark.fits
def test_undetermined_is_exit_code_one(tmp_path):
    """Under light that is the same from everywhere a small roughness shows nowhere, whatever a processor can do: `make
    test-arithmetic` runs this as another one would."""
    write_exr(tmp_path / "grey.exr", np.ones((8, 16, 3), np.float32))
    iron = metal("Fe")
    options = SynthOptions(TrueMetal(iron.n, iron.k, 0.02), size=24, spp=64, views=1, env=str(tmp_path / "grey.exr"))
    scene = synthesise(options, tmp_path / "scene")
    ended = run("fit", scene, "-o", tmp_path / "out", *QUICK, "--type", "metal")
    assert (ended.returncode, ended.stderr) == (1, "")
    found = strictly_parsed(tmp_path / "out" / "result.json")
    assert (found["status"], found["materials"][0]["determined"]["alpha"]) == ("not_determined", False)


# Progress


def on_a_terminal(arguments: Sequence[object], interrupt_at: bytes = b"") -> tuple[int, bytes, bytes]:
    """Run with a terminal for standard error: exit code, standard output, and what the terminal showed.

    Args:
        interrupt_at: send Ctrl-C's signal once this has been shown.
    """
    try:
        ours, theirs = pty.openpty()
    except OSError:  # as in a chroot without /dev/pts
        pytest.skip("this machine lends no pseudo-terminals")
    process = subprocess.Popen([*COMMAND, *map(str, arguments)], stdout=subprocess.PIPE, stderr=theirs, env=ENVIRONMENT)
    os.close(theirs)
    shown = b""
    while True:
        try:
            shown += os.read(ours, 4096)
        except OSError:  # how Linux says that the other side is closed
            break
        if interrupt_at and interrupt_at in shown:
            time.sleep(0.3)  # into the stage, not only at its beginning
            process.send_signal(signal.SIGINT)
            interrupt_at = b""
    os.close(ours)
    assert process.stdout is not None
    output = process.stdout.read()
    process.stdout.close()
    return process.wait(), output, shown


def test_progress_is_shown_on_a_terminal_only(gold_photographs, tmp_path):
    arguments = ["synth", "--metal", "Fe", "--size", "16", "--spp", "16", "-o", tmp_path]
    code, output, shown = on_a_terminal(arguments)
    assert (code, output.decode()) == (0, f"{tmp_path / 'scene.toml'}\n")
    assert b"photograph 1 of 3" in shown
    code, output, shown = on_a_terminal([*arguments, "--quiet"])
    assert (code, output.decode(), shown) == (0, f"{tmp_path / 'scene.toml'}\n", b"")


# Interruption


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_ctrl_c_leaves_the_old_result_whole(gold_photographs, done, tmp_path):
    out = Path(shutil.copytree(done[1], tmp_path / "out"))
    before = contents(out)
    arguments = ["fit", gold_photographs / "scene.toml", "-o", out, "--fidelity", "reference"]
    code, output, shown = on_a_terminal(arguments, interrupt_at=b"integrating")
    assert (code, output) == (130, b"")
    assert b"fit-material: interrupted" in shown
    assert b"Traceback" not in shown
    assert contents(out) == before


def wait_for_library(pid: int, name: str) -> None:
    """Until a process has mapped a file of that name, or for a second and a half where nobody can tell."""
    maps, begun = Path(f"/proc/{pid}/maps"), time.monotonic()
    if not maps.exists():
        time.sleep(1.5)
    while maps.exists() and name not in maps.read_text() and time.monotonic() < begun + 60:
        time.sleep(0.02)


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_at_the_start_is_as_quiet(gold_photographs, tmp_path, sent):
    process = subprocess.Popen(
        [*COMMAND, "fit", gold_photographs / "scene.toml", "-o", tmp_path / "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    wait_for_library(process.pid, "torch")  # while it and jax are being imported
    process.send_signal(sent)
    output, errors = process.communicate()
    assert (process.returncode, output) == (130, "")
    told = "interrupted; files of earlier results are as they were, and frontier and batch can go on"
    assert errors == f"fit-material: {told}\n"


def test_ctrl_c_while_the_commands_are_imported_is_quiet(tmp_path):
    """In place of typer, something waits for the signal."""
    (tmp_path / "typer.py").write_text("import time\nprint(end='!', flush=True)\ntime.sleep(60)\n")
    environment = ENVIRONMENT | {"PYTHONPATH": f"{tmp_path}:{SOURCE}"}
    process = subprocess.Popen(
        [sys.executable, "-m", "fit_material", "--help"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
    )
    assert process.stdout is not None
    assert process.stdout.read(1) == b"!"
    process.send_signal(signal.SIGINT)
    assert process.communicate() == (b"", b"")
    assert process.returncode == 130


# What is not the user's fault


def test_our_own_mistakes_are_one_line_too(capfd, monkeypatch, gold_scene):
    def broken(*_):
        raise ZeroDivisionError("in two\nlines")

    monkeypatch.setattr("fit_material.fitter.observations.scene_data.read_scene", broken)
    monkeypatch.delenv("FIT_MATERIAL_DEBUG", raising=False)
    monkeypatch.setattr(sys, "argv", ["fit-material", "fit", str(gold_scene), "-o", str(gold_scene.parent / "out")])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == 1
    printed = capfd.readouterr().err
    assert re.fullmatch(r"fit-material: internal error, please report it: in two lines \(.*\)\n", printed)


@pytest.mark.parametrize("where", ["gc.callbacks.append(lambda phase, info: press())", "Finalised()"])
def test_an_interrupt_that_python_would_swallow_is_heard_afterwards(where):
    code = f"""
import gc, os, signal, time
from fit_material.fitter.commands.app import _watch_for_interrupts
pressed = _watch_for_interrupts()
def press():
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.05)
class Finalised:
    def __del__(self):
        press()
try:
    {where}
    gc.collect()
    gc.callbacks.clear()
    time.sleep(20)
    print("lost")
except KeyboardInterrupt:
    print("heard", pressed.is_set())
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (run.stdout, run.stderr) == ("heard True\n", "")
