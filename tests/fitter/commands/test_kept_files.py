"""No command overwrites what it reads, and into a folder none writes over files that others wrote or changed."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer

from fit_material.fitter.batch.batch import alone_in
from fit_material.fitter.batch.workers.record import replaceable_by_batch
from fit_material.fitter.commands.fit import demo
from fit_material.fitter.export.export import export
from fit_material.fitter.frontier import compare as frontier_files
from fit_material.fitter.frontier.compare import Question, compare
from fit_material.fitter.frontier.rungs import LADDER
from fit_material.fitter.result.schema import Maps, OutputFile, write_result
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.light_probe.probe import probe
from fit_material.renderer.materials.ground_truth import TrueMatte
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from tests.fitter.commands.test_view import GOLD, ball, view  # noqa: F401 — a fixture
from tests.fitter.result.test_schema import gold, result

INPUT = "expected another place: an input is never overwritten"
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def contents(folder: Path) -> dict[str, bytes]:
    """Files by name, spelled in ASCII: pytest-xdist sends no message with halves of characters."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {ascii(str(path.relative_to(folder)))[1:-1]: path.read_bytes() for path in files}


def sentence(act, folder: Path) -> str:
    """How it is refused, without a change in the folder."""
    before = contents(folder)
    with pytest.raises(InputError) as told:
        act()
    assert contents(folder) == before
    return str(told.value)


# synth


@pytest.fixture
def quick(tmp_path):
    """Options of photographs that take no time, with changes."""
    write_exr(tmp_path / "sky.exr", np.ones((8, 16, 3), np.float32))

    def options(**changes) -> SynthOptions:
        usual = {"views": 2, "size": 8, "spp": 1, "env": str(tmp_path / "sky.exr"), "variant": "scalar_rgb"}
        return SynthOptions(TrueMatte((0.5, 0.3, 0.2)), **{**usual, **changes})

    return options


SYNTH = "expected no file of that name, or one that the truth.json there lists and nobody has changed"


def test_synth_replaces_its_own_files(quick, tmp_path):
    out = tmp_path / "out"
    for views, seed in ((3, 0), (1, 1), (3, 2)):  # the second leaves files of the first for the third
        synthesise(quick(views=views, seed=seed), out)
    truth = json.loads((out / "truth.json").read_text())
    assert {each["path"] for each in truth["outputs"]} == contents(out).keys() - {"truth.json"}
    assert "earlier_outputs" not in truth


def test_synth_remembers_what_an_earlier_call_left(quick, tmp_path):
    synthesise(quick(views=2), tmp_path / "out")
    synthesise(quick(views=1), tmp_path / "out")
    truth = json.loads((tmp_path / "out" / "truth.json").read_text())
    assert [each["path"] for each in truth["earlier_outputs"]] == ["view_1.exr"]


@pytest.mark.parametrize("name", ["scene.toml", "view_1.exr", "truth.json", "environment.exr"])
def test_synth_overwrites_nobodys_files(quick, tmp_path, name):
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine")
    assert sentence(lambda: synthesise(quick(), out), out) == (
        f"-o: is {out / name}, {SYNTH}; move it, or name another place"
    )


def test_synth_does_not_overwrite_a_scene_that_somebody_has_changed(quick, tmp_path):
    out = tmp_path / "out"
    scene = synthesise(quick(), out)
    scene.write_text(scene.read_text() + "# mine\n")
    assert sentence(lambda: synthesise(quick(), out), out).startswith(f"-o: is {scene}, {SYNTH}")


def test_synth_replaces_the_files_of_older_versions(quick, tmp_path):
    out = tmp_path / "out"
    synthesise(quick(), out)
    truth = json.loads((out / "truth.json").read_text())
    del truth["outputs"]
    (out / "truth.json").write_text(json.dumps(truth))
    synthesise(quick(seed=1), out)
    assert "outputs" in json.loads((out / "truth.json").read_text())


def test_synth_overwrites_none_of_its_inputs(quick, tmp_path):
    out = tmp_path / "out"
    synthesise(quick(), out)
    told = sentence(lambda: synthesise(quick(env=str(out / "environment.exr")), out), out)
    assert told == f"-o: is {out / 'environment.exr'}, {INPUT}"


def test_synth_leaves_a_mesh_that_lies_there_already_as_it_is(quick, tmp_path):
    mesh = tmp_path / "tetra.obj"
    mesh.write_text(TETRAHEDRON)
    before = mesh.stat()
    synthesise(quick(mesh=mesh), tmp_path)
    assert mesh.stat() == before


def test_synth_refuses_a_mesh_that_no_scene_file_can_name(quick, tmp_path):
    mesh = tmp_path / os.fsdecode(b"t\xe9tra.obj")
    mesh.write_text(TETRAHEDRON)
    told = sentence(lambda: synthesise(quick(mesh=mesh), tmp_path / "out"), tmp_path)
    assert told == rf"--mesh: is {tmp_path}/t\udce9tra.obj, expected a file whose name is UTF-8, as scene.toml is"


def test_synth_says_before_its_work_that_the_disk_is_too_small(quick, tmp_path, monkeypatch):
    """Four channels of 4 bytes a pixel, and three of the map."""
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1_000))
    told = sentence(lambda: synthesise(quick(), tmp_path / "out"), tmp_path)
    size = f"{(2 * 8 * 8 * 16 + 8 * 16 * 12) / 1e6:.3g} MB"
    expected = f"expected a disk with {size} free for what is to be written, but it has 0.001 MB"
    assert told == f"-o: is {tmp_path / 'out'}, {expected}"
    assert not (tmp_path / "out").exists()


def limited(size: int, *arguments: object) -> subprocess.CompletedProcess[str]:
    """The command where no file can be longer than so many bytes, as on a disk that is full."""
    code = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}));"
    code += "from fit_material.fitter.commands.app import program; program()"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_synth_on_a_disk_that_fills_up_leaves_nothing(tmp_path):
    write_exr(tmp_path / "sky.exr", np.ones((8, 16, 3), np.float32))
    out, how = tmp_path / "out", ("--env", tmp_path / "sky.exr", "--variant", "scalar_rgb", "--quiet")
    ended = limited(3_000, "synth", "--metal", "Au", "-o", out, "--views", "1", "--size", "32", "--spp", "1", *how)
    told = f"fit-material: -o: is {out}, expected a folder that can be written (File too large)\n"
    assert (ended.returncode, ended.stdout, ended.stderr) == (2, "", told)
    assert not out.exists()


def test_a_demo_can_be_made_twice(tmp_path, monkeypatch):
    """Its photographs; its fit is a fit."""
    monkeypatch.setattr("fit_material.fitter.commands.fit._fit", lambda *_: 0)
    monkeypatch.setattr(
        "fit_material.renderer.synthesis.synthesise.SynthOptions",
        lambda known, **_: SynthOptions(known, views=1, size=8, spp=1),
    )
    for _ in range(2):
        with pytest.raises(typer.Exit):
            demo(tmp_path / "demo", quiet=True)


def test_a_demo_tells_of_a_users_file_before_its_photographs(tmp_path):
    (tmp_path / "sphere.mtl").write_text("mine")
    told = sentence(lambda: demo(tmp_path, quiet=True), tmp_path)
    expected = "expected no file of that name, or one that the result.json there lists and nobody has changed"
    assert told == f"-o: is {tmp_path / 'sphere.mtl'}, {expected}; move it, or name another place"


# export

EXPORT = "expected no file of that name, or one of the same content, or --replace; move it, or name another place"


def test_export_replaces_no_other_content_unless_asked_to(tmp_path):
    (tmp_path / "ball.mtl").write_text("mine")
    told = sentence(lambda: export(result(), ["mtl", "gltf"], tmp_path, "ball"), tmp_path)
    assert told == f"-o: is {tmp_path / 'ball.mtl'}, {EXPORT}"
    export(result(), ["mtl"], tmp_path, "ball", replace=True)
    before = (tmp_path / "ball.mtl").stat().st_mtime_ns
    export(result(), ["mtl"], tmp_path, "ball")  # again, the same
    assert (tmp_path / "ball.mtl").stat().st_mtime_ns == before


def test_export_may_replace_what_a_fit_wrote_there(tmp_path):
    export(result(), ["mtl"], tmp_path, "ball")
    digest = hashlib.sha256((tmp_path / "ball.mtl").read_bytes()).hexdigest()
    write_result(
        result().model_copy(update={"outputs": (OutputFile(path="ball.mtl", sha256=digest),)}), tmp_path / "result.json"
    )
    other = result(materials=(gold(alpha=0.3),))
    export(other, ["mtl"], tmp_path, "ball")
    (tmp_path / "ball.mtl").write_text("mine")
    assert sentence(lambda: export(other, ["mtl"], tmp_path, "ball"), tmp_path).startswith("-o: is ")


def test_export_does_not_overwrite_a_texture_of_the_result(tmp_path):
    (tmp_path / "ball.gltf").write_bytes(b"PNG")
    mapped = result(materials=(gold(maps=Maps.model_construct(color="ball.gltf", color_seen="seen.png")),))
    told = sentence(lambda: export(mapped, ["gltf"], tmp_path, "ball", tmp_path / "a.json", replace=True), tmp_path)
    assert told == f"-o: is {tmp_path / 'ball.gltf'}, {INPUT}"


# probe, view, frontier, batch


def test_probe_does_not_overwrite_a_photograph(tmp_path):
    write_exr(tmp_path / "ball.exr", np.ones((32, 32, 3), np.float32))
    os.link(tmp_path / "ball.exr", tmp_path / "same.exr")
    told = sentence(lambda: probe([tmp_path / "ball.exr"], tmp_path / "same.exr"), tmp_path)
    assert told == f"-o: is {tmp_path / 'same.exr'}, {INPUT}"


@pytest.mark.parametrize("name", ["room.exr", "ball.png"])
def test_view_does_not_overwrite_what_it_draws(ball, gl, name, tmp_path):  # noqa: F811
    from PIL import Image

    Image.new("RGB", (4, 4), "red").save("ball.png")
    with open("ball.thesis.mtl", "a") as file:
        file.write("map_Kd ball.png\n")
    ball.write_text(TRIANGLE)
    told = sentence(lambda: view(ball, "--env", "room.exr", "--screenshot", name, "--size", "20", "20"), tmp_path)
    assert told == f"--screenshot: is {name}, {INPUT}"


TRIANGLE = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/3/1\n"


def test_a_turntable_does_not_overwrite_a_texture(ball, gl, tmp_path):  # noqa: F811
    from PIL import Image

    Path("film").mkdir()
    Image.new("RGB", (4, 4), "red").save("film/frame_001.png")
    Path("ball.thesis.mtl").write_text(
        "newmtl default\nNs 0\nKd 1 1 1\nKa 1 1 1\nKs 0 0 0\nmap_Kd film/frame_001.png\n"
    )
    ball.write_text(TRIANGLE)
    arguments = ("--turntable", "film", "--frames", "3", "--size", "20", "20", "--env", "room.exr")
    told = sentence(lambda: view(ball, *arguments), tmp_path)
    assert told == f"--turntable: is film/frame_001.png, {INPUT}"


@pytest.mark.parametrize("name", ["out.png", pytest.param("out.exr", marks=pytest.mark.slow)])
def test_view_on_a_full_disk_says_so_and_leaves_nothing(ball, gl, name):  # noqa: F811
    ended = limited(100, "view", ball, "--env", "room.exr", "--screenshot", name, "--size", "64", "64")
    assert ended.returncode == 2
    assert ended.stderr.endswith("can be written (File too large)\n")
    assert ended.stderr.count("\n") == 1
    assert sorted(path.name for path in Path().iterdir()) == ["ball.obj", "ball.thesis.mtl", "room.exr", "white.exr"]


@pytest.mark.parametrize("name", ["frontier.png", "frontier.csv", "frontier.html", "frontier.json"])
def test_frontier_tells_before_its_fits_of_files_that_are_not_its_own(gold_scene, name, monkeypatch):
    monkeypatch.setattr(frontier_files, "all_runs", None)
    out = gold_scene.parent
    (out / name).write_text('{"rows": []}')
    asked = Question(gold_scene, LADDER[:1], 1, "worst", False, "metal", "cpu")
    told = sentence(lambda: compare(asked, out, "", lambda stage, share: None), out)
    expected = "expected no file of that name, or one of frontier's, beside its frontier.json"
    assert told == f"-o: is {out / name}, {expected}; move it, or name another place"


def test_batch_tells_before_its_fits_of_a_summary_that_is_not_its_own(tmp_path):
    (tmp_path / "summary.html").write_text("mine")

    def enter() -> None:
        with alone_in(tmp_path):
            pytest.fail("the batch must not begin")

    expected = "expected no file of that name, or one of an earlier batch, beside its summary.json"
    told = sentence(enter, tmp_path)
    assert told == f"-o: is {tmp_path / 'summary.html'}, {expected}; move it, or name another place"


def test_batch_replaces_in_a_results_folder_what_a_fit_wrote_and_its_own_note(tmp_path):
    (tmp_path / "batch.json").write_text("mine")
    with pytest.raises(InputError, match=r"batch\.json, expected no file of that name"):
        replaceable_by_batch(tmp_path).require(tmp_path, ["batch.json"])
    write_result(result().model_copy(update={"outputs": ()}), tmp_path / "result.json")
    replaceable_by_batch(tmp_path).require(tmp_path, ["batch.json", "result.json"])
