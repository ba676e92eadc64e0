"""A fit replaces its own files alone: what it reads, and what others wrote or changed, is never overwritten."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from fit_material.fitter.commands import app
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline import fit_scene as pipeline
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.pipeline.output_files import output_names
from fit_material.fitter.result.schema import OutputFile, read_result, write_result
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.materials.ground_truth import TrueMatte
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

QUICK = FitOptions(PRESETS["preview"], type="metal")
FOREIGN = "expected no file of that name, or one that the result.json there lists and nobody has changed"
INPUT = "expected another place: an input is never overwritten"


@pytest.fixture(scope="module")
def fitted(gold_photographs, tmp_path_factory) -> Path:
    """The folder of a fit of gold."""
    out = tmp_path_factory.mktemp("fitted") / "out"
    fit_scene(gold_photographs / "scene.toml", out, QUICK)
    return out


@pytest.fixture
def out(fitted, tmp_path) -> Path:
    """A copy of it, to spoil."""
    return Path(shutil.copytree(fitted, tmp_path / "out"))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def digests(folder: Path) -> dict[str, str]:
    return {name: hashlib.sha256(data).hexdigest() for name, data in contents(folder).items()}


def refused(monkeypatch, capfd, scene: Path, out: Path) -> str:
    """The sentence by which `fit` refuses a folder, before its work and without a change there."""
    before = contents(out)
    monkeypatch.setattr(pipeline, "fit_planned", None)
    monkeypatch.setattr(sys, "argv", ["fit-material", "fit", str(scene), "-o", str(out), "--quiet"])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == 2
    assert contents(out) == before
    return capfd.readouterr().err.removeprefix("fit-material: ").removesuffix("\n")


def test_the_result_lists_every_file_that_was_written(fitted):
    written = digests(fitted)
    del written["result.json"]  # which cannot hold its own
    listed = json.loads((fitted / "result.json").read_text())["outputs"]
    assert {each["path"]: each["sha256"] for each in listed} == written
    assert all(set(each) == {"path", "sha256"} for each in listed)


def test_the_same_fit_again_replaces_its_files_and_remembers_older_ones(gold_photographs, out):
    """A file of an earlier fit that this one does not write may be replaced by a third, if nobody changes it."""
    result = read_result(out / "result.json")
    older = {"sphere.transforms.json": "{}", "changed.mtl": "newmtl a\n"}
    listed = [OutputFile(path=name, sha256=hashlib.sha256(text.encode()).hexdigest()) for name, text in older.items()]
    write_result(result.model_copy(update={"outputs": (*(result.outputs or ()), *listed)}), out / "result.json")
    for name, text in older.items():
        (out / name).write_text(text)
    (out / "changed.mtl").write_text("newmtl b\n")
    before = digests(out)
    fit_scene(gold_photographs / "scene.toml", out, FitOptions(PRESETS["preview"], type="metal", seed=1))
    now, again = digests(out), read_result(out / "result.json")
    assert {name for name in now if now[name] == before[name]} == {*older}
    assert [(each.path, each.sha256) for each in again.earlier_outputs or ()] == [
        ("sphere.transforms.json", before["sphere.transforms.json"])
    ]
    assert again.outputs is not None
    assert {each.path: each.sha256 for each in again.outputs} == {
        name: digest for name, digest in now.items() if name not in {"result.json", *older}
    }


@pytest.mark.parametrize("name", ["sphere.mtl", "comparison.png", "report.html", "result.json"])
def test_a_users_own_file_beside_the_scene_is_told_before_the_fit(gold_scene, name, monkeypatch, capfd):
    (gold_scene.parent / name).write_bytes(b"mine")
    told = refused(monkeypatch, capfd, gold_scene, gold_scene.parent)
    assert told == f"-o: is {gold_scene.parent / name}, {FOREIGN}; move it, or name another place"


def test_a_result_that_somebody_has_changed_since_is_not_overwritten(gold_scene, out, monkeypatch, capfd):
    (out / "sphere.mtl").write_text((out / "sphere.mtl").read_text() + "# mine\n")
    told = refused(monkeypatch, capfd, gold_scene, out)
    assert told == f"-o: is {out / 'sphere.mtl'}, {FOREIGN}; move it, or name another place"


@pytest.mark.parametrize("way", ["photograph", "link", "second name"])
def test_an_input_is_not_overwritten_whatever_its_name(gold_scene, out, way, monkeypatch, capfd):
    """Not even where a result lists it."""
    photograph, place = gold_scene.with_name("view_0.exr"), out / "comparison.png"
    if way == "photograph":
        place.unlink()
        gold_scene.write_text(gold_scene.read_text().replace('image = "view_0.exr"', f'image = "{place}"'))
        photograph.rename(place)
    else:
        place.unlink()
        (os.symlink if way == "link" else os.link)(photograph, place)
    result = read_result(out / "result.json")
    digest = hashlib.sha256(place.read_bytes()).hexdigest()
    files = [
        each if each.path != place.name else OutputFile(path=each.path, sha256=digest) for each in result.outputs or ()
    ]
    write_result(result.model_copy(update={"outputs": tuple(files)}), out / "result.json")
    told = refused(monkeypatch, capfd, gold_scene, out)
    assert told == f"-o: is {place}, {INPUT}"


def test_a_file_that_comes_while_the_fit_goes_on_is_not_overwritten_either(gold_photographs, tmp_path):
    out = tmp_path / "out"

    def progress(stage: str, share: float) -> None:
        if stage == "writing the report":
            (out / "sphere.mtl").write_text("mine")

    with pytest.raises(InputError) as told:
        fit_scene(gold_photographs / "scene.toml", out, QUICK, progress)
    assert str(told.value) == f"-o: is {out / 'sphere.mtl'}, {FOREIGN}; move it, or name another place"
    assert contents(out) == {"sphere.mtl": b"mine"}


def without_a_list(out: Path) -> None:
    """As versions wrote results that listed nothing."""
    data = json.loads((out / "result.json").read_text())
    del data["outputs"]
    (out / "result.json").write_text(json.dumps(data))


def test_files_of_older_versions_are_known_by_name(gold_scene, out, monkeypatch, capfd):
    """Those called after an input, as they were; another scene's are somebody's own."""
    without_a_list(out)
    ball = trimesh.creation.icosphere(subdivisions=3)
    (gold_scene.parent / "cup.obj").write_text(str(ball.export(file_type="obj", include_normals=True)))
    cup = gold_scene.with_name("cup.toml")
    cup.write_text(gold_scene.read_text().replace('shape = "sphere"', 'mesh = "cup.obj"'))
    (out / "cup.mtl").write_text("mine")
    told = refused(monkeypatch, capfd, cup, out)
    assert told == f"-o: is {out / 'cup.mtl'}, {FOREIGN}; move it, or name another place"
    monkeypatch.undo()
    fit_scene(gold_scene, out, QUICK)
    assert {each.path for each in read_result(out / "result.json").outputs or ()} == {
        "report.html",
        "comparison.png",
        "sphere.mtl",
        "sphere.thesis.mtl",
    }


def test_a_result_that_cannot_be_read_is_nobodys(gold_scene, out, monkeypatch, capfd):
    (out / "result.json").write_text('{"format": 1')
    told = refused(monkeypatch, capfd, gold_scene, out)
    assert told == f"-o: is {out / 'result.json'}, {FOREIGN}; move it, or name another place"


def test_names_are_known_before_a_fit():
    """By the names that fits have given their files."""
    assert output_names("ball", ["a"], FitOptions()) == [
        "result.json",
        "report.html",
        "comparison.png",
        "ball.mtl",
        "ball.thesis.mtl",
    ]
    both = output_names("ball", ["a", "b c"], FitOptions(maps=("color",), refine_pose=True))
    assert both[5:] == [
        "ball.transforms.json",
        "ball_0_a_color.png",
        "ball_0_a_color_seen.png",
        "ball_1_b_c_color.png",
        "ball_1_b_c_color_seen.png",
    ]


# Work that would be lost at the end


@pytest.fixture(scope="module")
def clay(tmp_path_factory) -> Path:
    """A small scene of a matte ball that is a mesh, without texture coordinates."""
    folder = tmp_path_factory.mktemp("clay")
    ball = trimesh.creation.icosphere(subdivisions=3)
    (folder / "ball.obj").write_text(str(ball.export(file_type="obj", include_normals=True)))
    options = SynthOptions(TrueMatte((0.5, 0.3, 0.2)), mesh=folder / "ball.obj", size=24, spp=64, views=1)
    return synthesise(options, folder / "photographs")


def with_mesh(clay: Path, folder: Path, name: str) -> Path:
    """The scene once more, its mesh by another name."""
    scene = Path(shutil.copytree(clay.parent, folder)) / "scene.toml"
    scene.with_name("ball.obj").rename(scene.with_name(name))
    scene.write_text(scene.read_text().replace('"ball.obj"', f'"{name}"'))
    return scene


MATTE = FitOptions(PRESETS["preview"], type="matte")


def test_a_mesh_may_have_a_long_name(clay, tmp_path):
    stem = "m" * 218
    out = tmp_path / "out"
    fit_scene(with_mesh(clay, tmp_path / "scene", f"{stem}.obj"), out, MATTE)
    assert {f"{stem}.mtl", f"{stem}.thesis.mtl", "result.json"} <= contents(out).keys()


def test_a_mesh_whose_name_is_too_long_for_its_results_is_told_before_the_fit(clay, tmp_path, monkeypatch, capfd):
    name = f"{'m' * 250}.obj"
    scene = with_mesh(clay, tmp_path / "scene", name)
    told = refused(monkeypatch, capfd, scene, tmp_path / "out")
    expected = f"expected a shorter name: the disk takes 255 bytes, and {'m' * 40}… has {250 + len('.thesis.mtl')}"
    assert told == f"{scene.with_name(name)}: {expected}"


def named_by_half_a_character(folder: Path) -> Path:
    """A GLB whose material JSON calls "\\ud800", which no UTF-8 holds."""
    material = trimesh.visual.material.PBRMaterial(name="half", baseColorFactor=[255, 255, 255, 255])
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(ball.vertices), 2)), material=material)
    data = bytes(ball.export(file_type="glb"))
    length = int.from_bytes(data[12:16], "little")
    text = data[20 : 20 + length].rstrip().replace(b'"half"', b'"\\ud800"')
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    path = folder / "half.glb"
    path.write_bytes(head + text + rest)
    return path


def test_a_material_that_no_file_can_name_is_fitted_under_another_name(clay, tmp_path):
    scene = Path(shutil.copytree(clay.parent, tmp_path / "scene")) / "scene.toml"
    named_by_half_a_character(scene.parent)
    scene.write_text(scene.read_text().replace('"ball.obj"', '"half.glb"'))
    fit_scene(scene, tmp_path / "out", MATTE)
    text = (tmp_path / "out" / "result.json").read_bytes().decode("utf-8")
    (material,) = json.loads(text)["materials"]
    assert material["name"] == r"\ud800"
    assert (tmp_path / "out" / "half.thesis.mtl").read_text("utf-8").startswith("newmtl ")


def test_a_scene_whose_path_is_not_utf8_is_told_before_the_fit(gold_photographs, tmp_path):
    folder = tmp_path / os.fsdecode(b"jos\xe9")
    shutil.copytree(gold_photographs, folder)
    with pytest.raises(InputError) as told:
        fit_scene(folder / "scene.toml", tmp_path / "out", QUICK)
    expected = "expected a path in UTF-8; rename its folder, or name the scene from within it"
    assert str(told.value) == rf"{tmp_path}/jos\udce9/scene.toml: {expected}"


def limited(size: int, *arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """The command where no file can be longer than so many bytes, as on a disk that is full."""
    code = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}));"
    code += "from fit_material.fitter.commands.app import program; program()"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=cwd)


HOW = ("--fidelity", "preview", "--type", "metal", "--no-check", "--quiet")


@pytest.mark.slow  # a fit
def test_folders_that_are_not_utf8_hold_results_that_are(gold_photographs, tmp_path):
    """The scene's, which is the current one, and the result's."""
    folder = Path(shutil.copytree(gold_photographs, tmp_path / os.fsdecode(b"jos\xe9")))
    out = folder / os.fsdecode(b"g\xfcltig")
    ended = limited(2**30, "fit", "scene.toml", "-o", out, *HOW, cwd=folder)
    assert (ended.returncode, ended.stderr) == (0, "")
    text = (out / "result.json").read_bytes().decode("utf-8")
    assert "scene.toml" in {each["path"] for each in json.loads(text)["inputs"]}
    assert "g\\udcfcltig" in (out / "report.html").read_bytes().decode("utf-8")  # of the command line


def test_a_disk_that_fills_up_at_the_end_of_a_fit_leaves_what_there_was(gold_photographs, out):
    before = contents(out)
    ended = limited(50_000, "fit", gold_photographs / "scene.toml", "-o", out, *HOW)
    expected = "expected a folder that can be written (File too large)"
    assert (ended.returncode, ended.stderr) == (2, f"fit-material: -o: is {out}, {expected}\n")
    assert contents(out) == before


def test_a_full_disk_is_told_before_the_fit(gold_photographs, tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "fit_planned", None)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1_234_000))
    with pytest.raises(InputError) as told:
        fit_scene(gold_photographs / "scene.toml", tmp_path / "out", QUICK)
    expected = "expected a disk with 4 MB free for what is to be written, but it has 1.23 MB"
    assert str(told.value) == f"-o: is {tmp_path / 'out'}, {expected}"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("kind", ["no text", "pipe"])
def test_a_matplotlibrc_in_the_working_folder_is_not_read(gold_photographs, tmp_path, kind):
    if kind == "pipe":
        os.mkfifo(tmp_path / "matplotlibrc")
    else:
        (tmp_path / "matplotlibrc").write_bytes(b"text.usetex: \xff\xfe True\n")
    code = (
        "from fit_material.fitter.html.plotting import without_the_users_settings as without; without()\n"
        "import matplotlib; print(matplotlib.rcParams['text.usetex'])"
    )
    command = [sys.executable, "-c", code]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, timeout=60)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "False\n", "")


def test_the_users_own_plots_need_latex_and_their_jax_a_gpu(gold_photographs, tmp_path):
    """Which nobody here calls: the page has its curves all the same."""
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nfont.family: nonsense\n")
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "MATPLOTLIBRC": str(tmp_path), "MPLBACKEND": "nonsense"}
    environment |= {"JAX_PLATFORMS": "nonsense"}
    arguments = ("fit", gold_photographs / "scene.toml", "-o", tmp_path / "out", *HOW)
    command = [sys.executable, "-m", "fit_material", *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "reflectance F" in (tmp_path / "out" / "report.html").read_text("utf-8")
