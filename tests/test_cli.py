"""The command line as a user meets it: exit codes, what is printed where, and every slip in one sentence."""

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
import trimesh
from PIL import Image
from test_result import result

from fitter import cli
from fitter.catalogue import metal
from renderer.images import write_exr
from renderer.synth import SynthOptions, synthesise
from renderer.truth import TrueMetal

COMMAND = [sys.executable, "-m", "fitter.cli"]
# a program beside a test must not take all cores with tensors of a few thousand numbers
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "TERM": "xterm", "COLUMNS": "100"}
FILES = {"result.json", "report.html", "comparison.png", "sphere.mtl", "sphere.thesis.mtl"}

# DESIGN.md's contract of result.json, written out once more
TOP = "format status message materials quality exposure model effects time inputs"
PARAMETERS = "n k f0 alpha roughness color reflectance"
MATERIAL = f"name type {PARAMETERS} stderr interval95 determined nearest from_prior"
QUALITY = "rms_relative psnr ssim"
MODEL = "fidelity reflectance lobe samples pixels dtype levels environment_size"
TIME = "load prepare solve report total"
EFFECTS = """reflection blur horizon light-reflection diffuse-irradiance energy-guard normal-map color-map
    ambient-occlusion double-bounce captured-neighbours depth-scaled-blur self-visibility interreflection
    exact-fresnel pixel-footprint"""


@pytest.fixture(scope="module")
def photographs(tmp_path_factory) -> Path:
    """Folder of a small scene of gold."""
    gold = metal("Au")
    options = SynthOptions(TrueMetal(gold.n, gold.k, alpha=0.25), size=40, spp=256, views=2)
    return synthesise(options, tmp_path_factory.mktemp("photographs")).parent


@pytest.fixture(scope="module")
def done(photographs, tmp_path_factory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """The main job, run once as a user runs it, and its folder."""
    out = tmp_path_factory.mktemp("done") / "new" / "folder"
    return run("fit", photographs / "scene.toml", "-o", out), out


@pytest.fixture
def scene(photographs, tmp_path) -> Path:
    """A copy of the small scene, to spoil."""
    return Path(shutil.copytree(photographs, tmp_path / "scene")) / "scene.toml"


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, check=False, env=ENVIRONMENT
    )


@pytest.fixture
def refused(capfd, monkeypatch, tmp_path):
    """Run a command inside this process; it must refuse in one sentence, which is returned."""

    def call(*arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", ["fit-material", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capfd.readouterr()
        assert ended.value.code == 2
        assert printed.out == ""
        assert re.fullmatch(r"fit-material: [^\n]+\n", printed.err)
        assert "internal error" not in printed.err
        assert not list(tmp_path.rglob(".unfinished-*"))
        return printed.err.removeprefix("fit-material: ").rstrip("\n")

    return call


def strictly_parsed(path: Path) -> dict:
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(path.read_text("utf-8"), parse_constant=refuse)


def spoil(scene: Path, old: str, new: str) -> None:
    text = scene.read_text()
    assert old in text
    scene.write_text(text.replace(old, new, 1))


# What comes out


def test_exit_code_and_streams(done):
    ended, out = done
    assert (ended.returncode, ended.stderr) == (0, "")
    lines = ended.stdout.splitlines()
    assert lines[0] == "default: metal, most like gold"
    assert [line.split()[0] for line in lines[1:6]] == ["n", "k", "f0", "alpha", "roughness"]
    assert lines[-1] == f"report: {out / 'report.html'}"
    assert {path.name for path in out.iterdir()} == FILES


def test_result_is_strict_json_with_every_key_of_the_contract(done, photographs):
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


def test_the_truth_is_within_the_stated_errors(done, photographs):
    (found,) = strictly_parsed(done[1] / "result.json")["materials"]
    (truth,) = strictly_parsed(photographs / "truth.json")["materials"]
    for value, true, error in zip(found["f0"], truth["f0"], found["stderr"]["f0"], strict=True):
        assert abs(value - true) < 4 * error + 0.005  # the margin of tests/test_pipeline.py
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
    assert html.count("data:image/png;base64,") == 6  # photograph, fit and difference of two views


def test_export_writes_the_same_material_files(done, tmp_path):
    ended = run("export", done[1] / "result.json", "-o", tmp_path)
    assert (ended.returncode, ended.stderr) == (0, "")
    written = {Path(line) for line in ended.stdout.splitlines()}
    assert written == set(tmp_path.iterdir())
    assert {path.name for path in written} == {"sphere.mtl", "sphere.thesis.mtl"}
    originals = {(done[1] / name).read_bytes() for name in ("sphere.mtl", "sphere.thesis.mtl")}
    assert {path.read_bytes() for path in written} == originals


def test_numbers_are_printed_with_four_digits():
    assert cli._with_error(0.000123456, 1.23456e-7) == "0.0001235 ± 1.235e-07"
    assert cli._with_error(12345.6, None) == "1.235e+04 (not determined)"


@pytest.mark.parametrize(
    ("names", "stem"),
    [([], "folder"), (["a.b.thesis.mtl", "a.b.mtl"], "a.b"), (["a.thesis.mtl", "b.thesis.mtl"], "folder")],
)
def test_exported_files_are_called_as_the_fit_called_them(tmp_path, names, stem):
    (tmp_path / "folder").mkdir()
    for name in names:
        (tmp_path / "folder" / name).touch()
    assert cli._stem(tmp_path / "folder" / "result.json") == stem


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


def test_undetermined_is_exit_code_one(tmp_path):
    """Under light that is the same from everywhere a small roughness shows nowhere."""
    write_exr(tmp_path / "grey.exr", np.ones((8, 16, 3), np.float32))
    iron = metal("Fe")
    options = SynthOptions(TrueMetal(iron.n, iron.k, 0.02), size=24, spp=64, views=1, env=str(tmp_path / "grey.exr"))
    scene = synthesise(options, tmp_path / "scene")
    ended = run("fit", scene, "-o", tmp_path / "out", "--fidelity", "preview", "--type", "metal")
    assert (ended.returncode, ended.stderr) == (1, "")
    assert strictly_parsed(tmp_path / "out" / "result.json")["status"] != "converged"


# Progress


def on_a_terminal(arguments: Sequence[object], interrupt_at: bytes = b"") -> tuple[int, bytes, bytes]:
    """Run with a terminal for standard error: exit code, standard output, and what the terminal showed.

    Args:
        interrupt_at: send Ctrl-C's signal once this has been shown.
    """
    ours, theirs = pty.openpty()
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


def test_progress_is_shown_on_a_terminal_only(photographs, tmp_path):
    arguments = ["synth", "--metal", "Fe", "--size", "16", "--spp", "16", "-o", tmp_path]
    code, output, shown = on_a_terminal(arguments)
    assert (code, output.decode()) == (0, f"{tmp_path / 'scene.toml'}\n")
    assert b"photograph 1 of 3" in shown
    code, output, shown = on_a_terminal([*arguments, "--quiet"])
    assert (code, output.decode(), shown) == (0, f"{tmp_path / 'scene.toml'}\n", b"")


# Interruption


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_ctrl_c_leaves_the_old_result_whole(photographs, done, tmp_path):
    out = Path(shutil.copytree(done[1], tmp_path / "out"))
    before = contents(out)
    arguments = ["fit", photographs / "scene.toml", "-o", out, "--fidelity", "reference"]
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


def test_ctrl_c_at_the_start_is_as_quiet(photographs, tmp_path):
    process = subprocess.Popen(
        [*COMMAND, "fit", photographs / "scene.toml", "-o", tmp_path / "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    wait_for_library(process.pid, "torch")  # while it and jax are being imported
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate()
    assert (process.returncode, output) == (130, "")
    assert errors == "fit-material: interrupted; files of earlier results are as they were\n"


# Slips in the arguments


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nonsense"], "no such command 'nonsense'; `fit-material --help` lists what there is"),
        (["fit", "a.toml"], "missing option '-o' / '--out'; `fit-material fit --help` lists what there is"),
        (["fit", "-o", "x"], "missing argument"),
        (["fit", "a.toml", "-o", "x", "--nope"], "no such option: --nope"),
        (["fit", "a.toml", "-o", "x", "--fidelity", "best"], "'best' is not one of 'viewer', 'preview'"),
        (["fit", "a.toml", "-o", "x", "--seed", "-1"], "invalid value for '--seed'"),
        (["fit", "a.toml", "-o", "x", "--seed", str(2**31)], "invalid value for '--seed'"),
        (["fit", "a.toml", "-o", ""], '-o: is "", expected a folder that can be written'),
        (["fit", "a.toml", "-o", "x", "--type", "wooden"], "'wooden' is not one of 'auto', 'metal'"),
        (["synth", "-o", "x"], "synth: is without a material, expected --metal NAME, --n and --k, or --color"),
        (["synth", "--metal", "Unobtainium", "-o", "x"], "Unobtainium"),
        (["synth", "--metal", "Au", "--alpha", "3", "-o", "x"], "--alpha: is 3.0, expected"),
        (["synth", "--metal", "Au", "--mesh", "no.obj", "-o", "x"], "no.obj: expected a mesh file here"),
        (["export", "no.json", "-o", "x"], "no.json: expected a result.json that can be read"),
    ],
)
def test_slips_in_the_arguments(refused, arguments, sentence, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert sentence in refused(*arguments)
    assert not list(tmp_path.iterdir())


def test_export_of_absurdly_nested_json(refused, tmp_path):
    (tmp_path / "deep.json").write_text("[" * 200000)
    assert "deep.json: expected JSON without" in refused("export", tmp_path / "deep.json", "-o", tmp_path / "out")


def test_export_to_an_unknown_format(refused, done, tmp_path):
    assert "usdz" in refused("export", done[1] / "result.json", "--to", "usdz", "-o", tmp_path)


@pytest.mark.parametrize("device", ["nonsense", "cuda:99"])
def test_unknown_devices(refused, scene, device):
    sentence = refused("fit", scene, "-o", scene.parent / "out", "--device", device)
    assert sentence.startswith(f"--device: is {device}, expected one that torch can use here: cpu")
    assert not (scene.parent / "out").exists()


def test_out_is_a_file(refused, scene, tmp_path):
    (tmp_path / "taken").write_text("mine")
    for out in (tmp_path / "taken", tmp_path / "taken" / "below"):
        sentence = refused("fit", scene, "-o", out)
        assert sentence.startswith(f"-o: is {out}, expected a folder that can be written")
    assert (tmp_path / "taken").read_text() == "mine"


def test_out_cannot_be_written(refused, scene):
    """Nothing can be made in /proc, not even by root, whom no permission stops."""
    assert refused("fit", scene, "-o", "/proc/out").startswith("-o: is /proc/out, expected a folder that can be")


# Slips in the scene


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[environment]", "[enviroment]", "enviroment: is {'map'"),
        ('map = "environment.exr"', 'mapp = "environment.exr"', 'environment.mapp: is "environment.exr", expected'),
        ("rotation = 0.0", 'rotation = "0"', 'environment.rotation: is "0", expected a number'),
        ("scale = 1.0", "scale = -1.0", "environment.scale: is -1.0, expected a number from 1e-12"),
        ('image = "view_0.exr"', "image = 3", "photographs[0].image: is 3, expected"),
        ('image = "view_1.exr"', 'image = "away.exr"', "photographs[1].image: is "),
        ("exposure = 1.0", 'exposure = "fit"', 'photographs[0].exposure: is "fit", expected a number'),
        ("[geometry]", "[geometry", "expected TOML"),
        ('shape = "sphere"', 'shape = "cube"', 'geometry.shape: is "cube", expected'),
        ('shape = "sphere"', 'mesh = "away.obj"', "geometry.mesh: is "),
    ],
)
def test_slips_in_the_scene_file(refused, scene, old, new, sentence):
    spoil(scene, old, new)
    told = refused("fit", scene, "-o", scene.parent / "out")
    assert told.startswith(f"{scene}: ") or sentence == "expected TOML"
    assert sentence in told


@pytest.mark.parametrize(
    ("old", "new", "nearest"),
    [
        ("[environment]", "[enviroment]", "environment"),
        ("fov = ", "fovy = ", "fov"),
        ("exposure = ", "exposur = ", "exposure"),
    ],
)
def test_unknown_keys_are_told_with_the_nearest_right_one(refused, scene, old, new, nearest):
    spoil(scene, old, new)
    assert f"expected a known key, the nearest is {nearest}" in refused("fit", scene, "-o", scene.parent / "out")


def test_a_sphere_has_one_material(refused, scene):
    scene.write_text(scene.read_text() + '\n[[materials]]\nname = "a"\n[[materials]]\nname = "b"\n')
    told = refused("fit", scene, "-o", scene.parent / "out")
    assert told.endswith("materials: is 2 tables, expected one: a sphere has one material")


def test_a_material_is_named_once(refused, scene):
    scene.write_text(scene.read_text() + '\n[[materials]]\nname = "a"\n' * 2)
    assert refused("fit", scene, "-o", scene.parent / "out").endswith("materials: is a, expected each name once")


def test_a_missing_scene(refused, tmp_path):
    told = refused("fit", tmp_path / "no.toml", "-o", tmp_path / "out")
    assert told == f"{tmp_path / 'no.toml'}: expected a readable scene file here (there is none)"
    assert not (tmp_path / "out").exists()


def test_image_and_camera_counts_differ(refused, scene):
    frame = {"file_path": "view_0.exr", "transform_matrix": np.eye(4).tolist()}
    (scene.parent / "transforms.json").write_text(json.dumps({"camera_angle_x": 0.6, "frames": [frame]}))
    text = re.sub(r"\[photographs.camera\][^\[]*(\[[^\]]*\][^\[]*){3}", "", scene.read_text())
    scene.write_text('cameras = "transforms.json"\n' + text)
    told = refused("fit", scene, "-o", scene.parent / "out")
    assert "photographs: is a list of 2, expected as many as transforms.json has cameras, 1" in told


# Slips in the files that a scene names


def test_unreadable_images(refused, scene):
    (scene.parent / "view_1.exr").write_bytes(b"not an image")
    told = refused("fit", scene, "-o", scene.parent / "out")
    assert told.startswith(f"{scene.parent / 'view_1.exr'}: expected a readable EXR image")


def masked(scene: Path, white: np.ndarray) -> Path:
    Image.fromarray(np.where(white, np.uint8(255), np.uint8(0))).save(scene.parent / "mask.png")
    spoil(scene, "exposure = 1.0", 'exposure = 1.0\nmask = "mask.png"')
    return scene


def test_masks_of_another_size(refused, scene):
    told = refused("fit", masked(scene, np.ones((30, 50), bool)), "-o", scene.parent / "out")
    assert "photographs[0].mask: is mask.png with 50 × 30 pixels, expected the photograph's 40 × 40" in told


def test_empty_masks(refused, scene):
    told = refused("fit", masked(scene, np.zeros((40, 40), bool)), "-o", scene.parent / "out")
    assert "photographs[0]: is mask.png, expected a mask or alpha channel with fully covered pixels" in told


def test_maps_of_another_shape(refused, scene):
    write_exr(scene.parent / "environment.exr", np.ones((10, 30, 3), np.float32))
    told = refused("fit", scene, "-o", scene.parent / "out")
    assert told.endswith("environment.exr: size: is 30 × 10, expected a map twice as wide as high")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "faces: is 0, expected at least one triangle with an area"),
        ("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "expected finite coordinates"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "v index of a face: is 9, expected at most 3"),
        ("", "expected"),
    ],
)
def test_broken_meshes(refused, scene, text, sentence):
    (scene.parent / "object.obj").write_text(text)
    spoil(scene, 'shape = "sphere"', 'mesh = "object.obj"')
    told = refused("fit", scene, "-o", scene.parent / "out")
    assert told.startswith(f"{scene.parent / 'object.obj'}: ")
    assert sentence in told


def looking(scene: Path, shape: str, origin: str, target: str) -> Path:
    """The scene with a sphere or an icosphere, its first camera somewhere else."""
    if shape == "icosphere":
        trimesh.creation.icosphere(subdivisions=2).export(scene.parent / "ball.ply")
        spoil(scene, 'shape = "sphere"', 'mesh = "ball.ply"')
    text = re.sub(r"origin = .*\ntarget = .*", f"origin = {origin}\ntarget = {target}", scene.read_text(), count=1)
    scene.write_text(text)
    return scene


@pytest.mark.parametrize("shape", ["sphere", "icosphere"])
def test_a_camera_inside_the_object(refused, scene, shape):
    told = refused("fit", looking(scene, shape, "[0, 0.1, 0.2]", "[1, 0, 0]"), "-o", scene.parent / "out")
    assert told.startswith(f"{scene}: photographs[0].camera: expected a camera outside the object")


@pytest.mark.parametrize("shape", ["sphere", "icosphere"])
def test_an_object_outside_the_frame(refused, scene, shape):
    told = refused("fit", looking(scene, shape, "[0, 0, 4]", "[0, 0, 9]"), "-o", scene.parent / "out")
    assert told.startswith(f"{scene}: photographs[0].camera: expected a camera that sees the object")
    assert "the object is outside the frame" in told


# What is not the user's fault


def test_our_own_mistakes_are_one_line_too(capfd, monkeypatch, scene):
    def broken(*_):
        raise ZeroDivisionError("in two\nlines")

    monkeypatch.setattr("fitter.loading.read_scene", broken)
    monkeypatch.delenv("FIT_MATERIAL_DEBUG", raising=False)
    monkeypatch.setattr(sys, "argv", ["fit-material", "fit", str(scene), "-o", str(scene.parent / "out")])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 1
    printed = capfd.readouterr().err
    assert re.fullmatch(r"fit-material: internal error, please report it: in two lines \(.*\)\n", printed)
