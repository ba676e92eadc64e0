"""`fit-material view` off screen: what it writes, and how every slip is told."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from fit_material.fitter.commands import app
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import read_image, write_exr
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.viewer.run import codes_of
from fit_material.renderer.viewer_model.model import read_model
from fit_material.renderer.viewer_model.shading import render as torch_render
from fit_material.renderer.viewer_model.viewer_light import surroundings
from fit_material.shaders.tone_mapping import tone_mapped

GOLD = "newmtl default\nNs 2\nKd 0.18 0.42 1.37\nKa 3.42 2.35 1.77\nKs 0.2 0.2 0.2\n"
MATTE = "newmtl default\nNs 0\nKd 0.5 0.25 1\nKa 1 1 1\nKs 0 0 0\n"
POSE = ("--origin", "0", "0", "4", "--target", "0", "0", "0")


@pytest.fixture
def ball(tmp_path, monkeypatch) -> Path:
    """A ball of gold, and a small studio map, in the current folder."""
    monkeypatch.chdir(tmp_path)
    text = trimesh.exchange.obj.export_obj(trimesh.creation.icosphere(3), include_normals=True)
    Path("ball.obj").write_text(text)
    Path("ball.thesis.mtl").write_text(GOLD)
    write_exr("room.exr", studio(32).radiance.numpy())
    write_exr("white.exr", np.ones((8, 16, 3), np.float32))
    return Path("ball.obj")


def view(*arguments: object) -> None:
    app.app(["view", *map(str, arguments)], standalone_mode=False)


def linear(*arguments: object) -> np.ndarray:
    view("ball.obj", "--screenshot", "out.exr", *arguments)
    return read_image("out.exr").radiance


def codes(path: str | Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image).astype(float)


def sentence(*arguments: object) -> str:
    with pytest.raises(InputError) as raised:
        view(*arguments)
    return str(raised.value)


def test_as_a_user_runs_it(ball, gl):
    """A process of its own: the contract's command, what it prints, and its exit code."""
    command = [sys.executable, "-m", "fit_material", "view", "ball.obj", "--env", "room.exr"]
    command += ["--mtl", "ball.thesis.mtl", "--screenshot", "gold.png", "--size", "40", "30", *POSE, "--fov", "35"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "gold.png\n", "")
    assert codes("gold.png").shape == (30, 40, 3)


def test_an_exr_is_linear_radiance_as_torch_has_it(ball, gl):
    drawn = linear("--env", "room.exr", "--size", 64, 64, "--antialias", 1, "--no-sky", *POSE)
    pose = look_at(*(torch.tensor(v, dtype=torch.float64) for v in ((0, 0, 4), (0, 0, 0), (0, 1, 0))))
    expected = torch_render(read_model(ball), Camera(pose, 64, 64, fov=35.0), surroundings(studio(32))).numpy()
    coverage = read_image("out.exr").alpha
    assert coverage is not None
    assert (coverage != expected[..., 3]).sum() <= 2
    seen = coverage * expected[..., 3] == 1
    np.testing.assert_allclose(drawn[seen], expected[..., :3][seen], rtol=1e-3)  # test_glsl_parity has the figure


def test_a_png_is_the_exr_under_tone_mapping(ball, gl):
    """One code of 255 apart at most: both round."""
    arguments = ("--env", "room.exr", "--size", 48, 32, "--antialias", 2, "--exposure", -1.5, "--curve", "aces")
    expected = tone_mapped(torch.from_numpy(linear(*arguments)), -1.5, "aces").numpy() * 255
    view("ball.obj", "--screenshot", "out.png", *arguments)
    drawn = codes("out.png")
    assert drawn.std() > 10
    assert np.abs(drawn - expected).max() <= 1


def test_without_sky_alpha_is_coverage_and_radiance_premultiplied(ball, gl):
    Path("ball.thesis.mtl").write_text(MATTE)
    drawn = linear("--env", "white.exr", "--no-sky", "--size", 33, 33, *POSE)
    alpha = read_image("out.exr").alpha
    assert alpha is not None
    assert ((alpha > 0) & (alpha < 1)).any()
    np.testing.assert_allclose(drawn, alpha[..., None] * [0.5, 0.25, 1.0], atol=1e-5)
    assert read_image("out.exr").alpha is not None
    linear("--env", "white.exr", "--size", 33, 33, *POSE)
    assert read_image("out.exr").alpha is None


def test_without_a_pose_the_camera_sees_the_whole_model(ball, gl):
    for size in ((60, 30), (30, 60)):
        linear("--env", "white.exr", "--no-sky", "--size", *size)
        alpha = read_image("out.exr").alpha
        assert alpha is not None
        rows, columns = np.nonzero(alpha)
        assert min(rows.min(), columns.min()) > 0
        assert rows.max() < size[1] - 1
        assert columns.max() < size[0] - 1
        assert len(rows) > 0.2 * 30 * 30


def test_light_and_ambient_of_the_command_line(ball, gl):
    """A Lambertian that faces the light sends out colour · (ambient + irradiance/π)."""
    Path("ball.thesis.mtl").write_text(MATTE)
    light = ("--light", 0, 0, 2, np.pi, 0, 2 * np.pi)
    drawn = linear("--env", "white.exr", "--ambient", 0.1, 0.2, 0.3, *light, *POSE, "--size", 3, 3, "--fov", 0.1)
    np.testing.assert_allclose(drawn[1, 1], [0.5 * 1.1, 0.25 * 0.2, 2.3], rtol=1e-4)


def test_rotation_turns_the_environment(ball, gl):
    """By 90° counter-clockwise seen from above: what was behind, at -Z, is then at -X, to the left."""
    wide = ("--size", 24, 24, "--fov", 60)
    turned = linear("--env", "room.exr", "--rotation", 90, *wide, *POSE)
    other = ("--origin", -4, 0, 0, "--target", 0, 0, 0)
    straight = linear("--env", "room.exr", *wide, *other)
    back = linear("--env", "room.exr", *wide, *POSE)
    np.testing.assert_allclose(turned[:4], straight[:4], rtol=0.02, atol=0.01)  # sky; resampled at another angle
    assert np.abs(turned[:4] - back[:4]).max() > 0.1


def test_a_turntable_is_a_sequence_of_pngs(ball, gl):
    view("ball.obj", "--env", "room.exr", "--turntable", "film", "--frames", 3, "--size", 16, 16, "--antialias", 1)
    frames = [codes(path) for path in sorted(Path("film").glob("*.png"))]
    assert [frame.shape for frame in frames] == [(16, 16, 3)] * 3
    assert not np.array_equal(frames[0], frames[1])


def test_remarks_are_told_and_the_picture_drawn(ball, gl, capsys):
    Path("ball.thesis.mtl").write_text(GOLD + "map_Ka missing.png\n")
    linear("--env", "white.exr", "--size", 8, 8)
    printed = capsys.readouterr()
    assert "missing.png" in printed.err
    assert printed.out == "out.exr\n"


def test_a_failure_leaves_the_older_picture(ball, gl):
    linear("--env", "white.exr", "--size", 8, 8)
    before = Path("out.exr").read_bytes()
    Path("ball.thesis.mtl").write_text(GOLD.replace("Ks 0.2", "Ks nan"))
    assert "nan" in sentence("ball.obj", "--env", "white.exr", "--screenshot", "out.exr", "--size", 8, 8)
    assert Path("out.exr").read_bytes() == before


def test_other_codes_of_types(ball, gl):
    """Assimp 3.2 multiplies Ns by 4: the same picture from 8 where 8 is told to be metal."""
    arguments = ("--env", "room.exr", "--size", 16, 16)
    pale = GOLD.replace("1.37", "0.9").replace("3.42 2.35 1.77", "0.5 0.5 0.5")  # numbers that a colour may have, too
    Path("ball.thesis.mtl").write_text(pale)
    expected = linear(*arguments)
    Path("ball.thesis.mtl").write_text(pale.replace("Ns 2", "Ns 8"))
    assert np.array_equal(linear(*arguments, "--codes", "glossy=4, metal=8"), expected)
    assert not np.array_equal(linear(*arguments), expected)  # an unknown code is matte


def test_codes():
    assert codes_of("metal=8,glossy=4") == {"matte": 0, "glossy": 4, "metal": 8}
    for wrong in ("metal", "metal=x", "steel=1", "metal=1,metal=2", "metal=1", ""):
        with pytest.raises(InputError, match="one whole number for each type"):
            codes_of(wrong)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--screenshot", "out.jpg"), "--screenshot: is out.jpg, expected a .png or .exr file"),
        (("--screenshot", "out"), "--screenshot: is out, expected a .png or .exr file"),
        (("--size", 0, 10), "--size: is 0 10, expected 1 to 16384 pixels along each side"),
        (("--fov", "nan"), "--fov: is nan, expected 0.01 to 179 degrees"),
        (("--exposure", "inf"), "--exposure: is inf, expected at most 60 stops"),
        (("--rotation", "nan"), "--rotation: is nan, expected an angle in degrees"),
        (("--antialias", 0), "--antialias: is 0, expected 1 to 16 samples along a pixel's side"),
        (("--origin", 0, "nan", 0), "--origin: is 0 nan 0, expected three finite numbers"),
        (("--target", 0, 0, 0), "--target: is 0 0 0, expected --origin beside it"),
        (("--ambient", 0, -1, 0), "--ambient: is 0 -1 0, expected three numbers from 0 to 1e+12"),
        (("--ambient", 1e39, 0, 0), "--ambient: is 1e+39 0 0, expected three numbers from 0 to 1e+12"),
        (("--env", "nowhere.exr"), "nowhere.exr: expected an image file here, but there is none"),
        (
            ("--origin", 0, 4, 0),
            "--origin: is 0 4 0, expected a point apart from --target, and not straight along --up from it",
        ),
        (
            ("--codes", "metal=0"),
            "--codes: is metal=0, expected one whole number for each type, as in matte=0,glossy=4,metal=8",
        ),
        (("--frames", 1, "--turntable", "film"), "--frames: is 1, expected 2 to 100000"),
        (("--photograph", "no.toml"), "no.toml: expected a readable scene file here (there is none)"),
        (
            ("--photograph", "no.toml", "--screenshot", "out.exr"),
            "--screenshot: is out.exr, expected a .png beside --photograph: comparisons are tone-mapped",
        ),
    ],
)
def test_slips(arguments, told, ball, gl):
    shot = () if {"--screenshot", "--turntable"} & {*arguments} else ("--screenshot", "out.png")
    environment = () if "--env" in arguments else ("--env", "white.exr")
    assert sentence("ball.obj", *environment, *shot, *arguments) == told
    assert not {*Path().glob("out*")}


def test_a_light_without_direction(ball):
    told = sentence("ball.obj", "--env", "white.exr", "--screenshot", "out.exr", "--light", 0, 0, 0, 1, 1, 1)
    assert told.startswith("--light: ")
    assert told.endswith("a direction that is not zero")


def test_files_that_cannot_be_read(ball):
    assert sentence("none.obj", "--env", "white.exr", "--screenshot", "a.png").startswith("none.obj: ")
    assert sentence("ball.obj", "--env", "white.exr", "--mtl", "none.mtl", "--screenshot", "a.png").startswith(
        "none.mtl: "
    )
