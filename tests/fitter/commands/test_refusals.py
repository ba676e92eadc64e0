"""Slips of a user of the command line, in arguments, scene and files: each refused in one sentence."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from fit_material.fitter.commands import app
from fit_material.renderer.images.image_file import write_exr
from tests.fitter.result.test_schema import result


@pytest.fixture
def refused(capfd, monkeypatch, tmp_path):
    """Run a command inside this process; it must refuse in one sentence, which is returned."""

    def call(*arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", ["fit-material", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            app.main()
        printed = capfd.readouterr()
        assert ended.value.code == 2
        assert printed.out == ""
        assert re.fullmatch(r"fit-material: [^\n]+\n", printed.err)
        assert "internal error" not in printed.err
        assert not list(tmp_path.rglob(".unfinished-*"))
        return printed.err.removeprefix("fit-material: ").rstrip("\n")

    return call


def spoil(scene: Path, old: str, new: str) -> None:
    text = scene.read_text()
    assert old in text
    scene.write_text(text.replace(old, new, 1))


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
        (["frontier", "a.toml", "-o", ""], '-o: is "", expected a folder that can be written'),
        (["fit", "a.toml", "-o", "x", "--type", "wooden"], "'--type': 'wooden' is not one of 'auto', 'metal'"),
        (
            ["fit", "a.toml", "-o", "x", "--polish", "--without", "interreflection"],
            "--polish: is --without interreflection, expected one of the two, not both",
        ),
        (
            ["fit", "a.toml", "-o", "x", "--with", "exact-fresnel", "--reflectance", "schlick"],
            "--with: is exact-fresnel, --reflectance schlick, expected --reflectance conductor, which is exact",
        ),
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


def test_export_to_an_unknown_format(refused, tmp_path):
    (tmp_path / "result.json").write_text(result().model_dump_json())
    assert "usdz" in refused("export", tmp_path / "result.json", "--to", "usdz", "-o", tmp_path)


@pytest.mark.parametrize("command", ["fit", "frontier"])
@pytest.mark.parametrize("device", ["nonsense", "cuda:99"])
def test_unknown_devices(refused, gold_scene, device, command):
    sentence = refused(command, gold_scene, "-o", gold_scene.parent / "out", "--device", device)
    assert sentence.startswith(f"--device: is {device}, expected one that torch can use here: cpu")
    assert not (gold_scene.parent / "out").exists()


def test_out_is_a_file(refused, gold_scene, tmp_path):
    (tmp_path / "taken").write_text("mine")
    for out in (tmp_path / "taken", tmp_path / "taken" / "below"):
        sentence = refused("fit", gold_scene, "-o", out)
        assert sentence.startswith(f"-o: is {out}, expected a folder that can be written")
    assert (tmp_path / "taken").read_text() == "mine"


def test_out_cannot_be_written(refused, gold_scene):
    """Nothing can be made in /proc, not even by root, whom no permission stops."""
    assert refused("fit", gold_scene, "-o", "/proc/out").startswith("-o: is /proc/out, expected a folder that can be")


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
        ("exposure = 1.0", 'exposure = "auto"', 'photographs[0].exposure: is "auto", expected a number'),
        ("exposure = 1.0", 'white_balance = "warm"', 'photographs[0].white_balance: is "warm", expected "fit", or'),
        ("[geometry]", "[geometry", "expected TOML"),
        ('shape = "sphere"', 'shape = "cube"', 'geometry.shape: is "cube", expected'),
        ('shape = "sphere"', 'mesh = "away.obj"', "geometry.mesh: is "),
    ],
)
def test_slips_in_the_scene_file(refused, gold_scene, old, new, sentence):
    spoil(gold_scene, old, new)
    told = refused("fit", gold_scene, "-o", gold_scene.parent / "out")
    assert told.startswith(f"{gold_scene}: ") or sentence == "expected TOML"
    assert sentence in told


@pytest.mark.parametrize(
    ("old", "new", "nearest"),
    [
        ("[environment]", "[enviroment]", "environment"),
        ("fov = ", "fovy = ", "fov"),
        ("exposure = ", "exposur = ", "exposure"),
    ],
)
def test_unknown_keys_are_told_with_the_nearest_right_one(refused, gold_scene, old, new, nearest):
    spoil(gold_scene, old, new)
    assert f"expected a known key, the nearest is {nearest}" in refused(
        "fit", gold_scene, "-o", gold_scene.parent / "out"
    )


def test_a_sphere_has_one_material(refused, gold_scene):
    gold_scene.write_text(gold_scene.read_text() + '\n[[materials]]\nname = "a"\n[[materials]]\nname = "b"\n')
    told = refused("fit", gold_scene, "-o", gold_scene.parent / "out")
    assert told.endswith("materials: is 2 tables, expected one: a sphere has one material")


def test_a_material_is_named_once(refused, gold_scene):
    gold_scene.write_text(gold_scene.read_text() + '\n[[materials]]\nname = "a"\n' * 2)
    assert refused("fit", gold_scene, "-o", gold_scene.parent / "out").endswith(
        "materials: is a, expected each name once"
    )


def test_a_missing_scene(refused, tmp_path):
    told = refused("fit", tmp_path / "no.toml", "-o", tmp_path / "out")
    assert told == f"{tmp_path / 'no.toml'}: expected a readable scene file here (there is none)"
    assert not (tmp_path / "out").exists()


def test_image_and_camera_counts_differ(refused, gold_scene):
    frame = {"file_path": "view_0.exr", "transform_matrix": np.eye(4).tolist()}
    (gold_scene.parent / "transforms.json").write_text(json.dumps({"camera_angle_x": 0.6, "frames": [frame]}))
    text = re.sub(r"\[photographs.camera\][^\[]*(\[[^\]]*\][^\[]*){3}", "", gold_scene.read_text())
    gold_scene.write_text('cameras = "transforms.json"\n' + text)
    told = refused("fit", gold_scene, "-o", gold_scene.parent / "out")
    assert "photographs: is a list of 2, expected as many as transforms.json has cameras, 1" in told


# Slips in the files that a scene names


def test_unreadable_images(refused, gold_scene):
    (gold_scene.parent / "view_1.exr").write_bytes(b"not an image")
    told = refused("fit", gold_scene, "-o", gold_scene.parent / "out")
    assert told.startswith(f"{gold_scene.parent / 'view_1.exr'}: expected a readable EXR image")


def masked(scene: Path, white: np.ndarray) -> Path:
    Image.fromarray(np.where(white, np.uint8(255), np.uint8(0))).save(scene.parent / "mask.png")
    spoil(scene, "exposure = 1.0", 'exposure = 1.0\nmask = "mask.png"')
    return scene


def test_masks_of_another_size(refused, gold_scene):
    told = refused("fit", masked(gold_scene, np.ones((30, 50), bool)), "-o", gold_scene.parent / "out")
    assert "photographs[0].mask: is mask.png with 50 × 30 pixels, expected the photograph's 40 × 40" in told


def test_empty_masks(refused, gold_scene):
    told = refused("fit", masked(gold_scene, np.zeros((40, 40), bool)), "-o", gold_scene.parent / "out")
    assert "photographs[0].mask: is mask.png, expected white pixels" in told


def test_maps_of_another_shape(refused, gold_scene):
    write_exr(gold_scene.parent / "environment.exr", np.ones((10, 30, 3), np.float32))
    told = refused("fit", gold_scene, "-o", gold_scene.parent / "out")
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
def test_broken_meshes(refused, gold_scene, text, sentence):
    (gold_scene.parent / "object.obj").write_text(text)
    spoil(gold_scene, 'shape = "sphere"', 'mesh = "object.obj"')
    told = refused("fit", gold_scene, "-o", gold_scene.parent / "out")
    assert told.startswith(f"{gold_scene.parent / 'object.obj'}: ")
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
def test_a_camera_inside_the_object(refused, gold_scene, shape):
    told = refused("fit", looking(gold_scene, shape, "[0, 0.1, 0.2]", "[1, 0, 0]"), "-o", gold_scene.parent / "out")
    assert told.startswith(f"{gold_scene}: photographs[0].camera: expected a camera outside the object")


@pytest.mark.parametrize("shape", ["sphere", "icosphere"])
def test_an_object_outside_the_frame(refused, gold_scene, shape):
    told = refused("fit", looking(gold_scene, shape, "[0, 0, 4]", "[0, 0, 9]"), "-o", gold_scene.parent / "out")
    assert told.startswith(f"{gold_scene}: photographs[0].camera: expected a camera that sees the object")
    assert "the object is outside the frame" in told
