"""`fit --maps color` from photographs to MTL; and normal and ambient-occlusion maps that a scene file names."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fit_material.fitter.commands import app
from fit_material.fitter.export.export import export
from fit_material.fitter.fitted.color_texture import codes
from fit_material.fitter.forward.lighting import lighting_for
from fit_material.fitter.observations.scene_data import load
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.result.schema import read_result, write_result
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.cameras.lens import Lens
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.images.image_file import read_image, write_exr
from fit_material.renderer.images.textures import Texture, read_texture
from fit_material.renderer.materials.bsdf import diffuse, plastic
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.normal_mapping import with_relief
from fit_material.renderer.viewer_model.model import read_model
from fit_material.shaders.materials.types import Matte
from tests.support.srgb_curve import decoded
from tests.support.textured import ball, pattern, photograph_textured, seen_at

ALPHA, REFLECTANCE = 0.2, 0.04
WITHIN = 0.03  # RMS of texels that two photographs see, linear: issue 8's figure


@pytest.fixture(scope="module")
def plastic_ball(tmp_path_factory) -> Path:
    """Photographs of a glossy ball under a pattern."""
    folder = tmp_path_factory.mktemp("plastic")
    bsdf = plastic((1.0, 1.0, 1.0), REFLECTANCE, ALPHA)
    return photograph_textured(folder, ball(folder / "its ball.obj"), pattern(64), bsdf, count=4, size=64, spp=1024)


@pytest.fixture(scope="module")
def fitted(plastic_ball, tmp_path_factory) -> Path:
    """The result's folder of these."""
    out = tmp_path_factory.mktemp("result")
    fit_scene(plastic_ball, out, FitOptions(PRESETS["preview"], type="glossy", maps=("color",)))
    return out


def texels(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """The map that was written, linear, and how many photographs see each texel."""
    maps = read_result(folder / "result.json").materials[0].maps
    assert maps is not None
    return read_texture(folder / maps.color, color=True).texels.numpy(), iio.imread(folder / maps.color_seen)


def test_the_texture_is_found_again(fitted):
    color, photographs = texels(fitted)
    error = (color - seen_at(pattern(64), len(color)))[photographs >= 2]
    assert len(error) > 1000
    assert np.sqrt((error**2).mean()) < WITHIN
    spread = pattern(64).std((0, 1)).min()  # what an even colour would leave
    assert spread > 4 * WITHIN


def test_roughness_and_reflectance_are_told_from_the_texture(fitted):
    material = read_result(fitted / "result.json").materials[0]
    assert material.alpha == pytest.approx(ALPHA, rel=0.05)  # its standard error is 2 %
    assert material.f0[0] == pytest.approx(REFLECTANCE, rel=0.1)


def test_the_result_has_the_mean_colour_and_names_the_maps(fitted):
    color, photographs = texels(fitted)
    material = json.loads((fitted / "result.json").read_text(encoding="utf-8"))["materials"][0]
    assert material["maps"] == {"color": "its_ball_color.png", "color_seen": "its_ball_color_seen.png"}
    # 8 bits of sRGB round by up to 0.0045, evenly to both sides
    np.testing.assert_allclose(material["color"], color[photographs > 0].mean(0), atol=1e-3)
    for value, (low, high) in zip(material["color"], material["interval95"]["color"], strict=True):
        assert low <= value <= high


def test_the_viewer_takes_the_map_for_the_whole_colour(fitted, plastic_ball):
    model = read_model(plastic_ball.with_name("its ball.obj"), fitted / "its ball.thesis.mtl")
    assert not model.remarks
    (appearance,) = model.appearances
    assert appearance.material.color.tolist() == [1, 1, 1]
    np.testing.assert_array_equal(appearance.maps.color.texels.numpy(), texels(fitted)[0])
    ordinary = (fitted / "its ball.mtl").read_text(encoding="utf-8")
    assert "Kd 1 1 1\n" in ordinary
    assert ordinary.endswith("map_Kd its_ball_color.png\n")


def test_exported_mtl_files_take_their_maps_along(fitted, tmp_path):
    result = read_result(fitted / "result.json")
    export(result, ["thesis"], tmp_path / "out", "ball", fitted / "result.json")
    assert (tmp_path / "out" / "its_ball_color.png").read_bytes() == (fitted / "its_ball_color.png").read_bytes()
    write_result(result, tmp_path / "result.json")
    with pytest.raises(
        InputError, match=r"materials\[0\].maps.color: is its_ball_color.png, expected a file beside it"
    ):
        export(result, ["mtl"], tmp_path / "out", "ball", tmp_path / "result.json")


def test_the_report_shows_the_map_and_pictures_have_it(fitted):
    page = (fitted / "report.html").read_text(encoding="utf-8")
    assert 'alt="colour map of default"' in page
    quality = read_result(fitted / "result.json").quality.overall
    assert quality.rms_relative is not None
    assert quality.rms_relative < 0.1  # 0.4 is what an even colour leaves


@given(st.floats(0, 1))
def test_codes_are_what_readers_decode(value):
    code = codes(np.full((2, 2, 3), value))[0, 0, 0] / 255
    assert abs(decoded(code) - value) < 0.0046  # half a code where the curve is steepest, 2.4/1.055/255/2


POSE = look_at(*(torch.tensor(v, dtype=torch.float64) for v in ((1.0, 2.0, 3.0), (0.1, 0.2, 0.0), (0.0, 1.0, 0.1))))
CAMERAS = {
    "pinhole": Camera(POSE, 80, 60, fov=40.0),
    "orthographic": Camera(POSE, 80, 60, "orthographic", scale=1.5),
    "lens": Camera(POSE, 80, 60, lens=Lens(100.0, 90.0, 41.0, 29.0, 0.1, -0.02, 1e-3, 2e-3, 1e-3)),
}


@settings(max_examples=25)
@given(st.sampled_from(sorted(CAMERAS)), st.floats(0, 80), st.floats(0, 60), st.floats(0.1, 50))
def test_film_is_the_inverse_of_rays(name, x, y, distance):
    camera = CAMERAS[name]
    origin, direction = camera.rays(torch.tensor([x]), torch.tensor([y]))
    found_x, found_y, before = camera.film(origin + distance * direction)
    assert (float(found_x), float(found_y)) == pytest.approx((x, y), abs=1e-5)  # x and y came in float32
    assert float(before) > 0
    assert float(camera.film(origin - distance * direction)[2]) < 0


@pytest.fixture
def refused(capfd, monkeypatch):
    """Run a command that has to end with code 2; what it says."""

    def call(*arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", ["fit-material", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            app.main()
        assert ended.value.code == 2
        return capfd.readouterr().err

    return call


def grey_scene(folder: Path, mesh: str, material: str = "") -> Path:
    """A scene file of one even photograph, to be refused."""
    picture = np.ones((16, 16, 4), np.float32)
    write_exr(folder / "view.exr", picture)
    write_exr(folder / "env.exr", np.ones((8, 16, 3), np.float32))
    scene = folder / "scene.toml"
    scene.write_text(
        f'[geometry]\n{mesh}\n[environment]\nmap = "env.exr"\n[[photographs]]\nimage = "view.exr"\n'
        f"[photographs.camera]\norigin = [0, 0, 4]\ntarget = [0, 0, 0]\n{material}",
        encoding="utf-8",
    )
    return scene


@pytest.mark.parametrize(
    ("mesh", "words", "told"),
    [
        ('shape = "sphere"', [], "--maps: is color, expected a mesh with texture coordinates, not a sphere"),
        ('mesh = "bare.obj"', [], "bare.obj: expected texture coordinates (vt) for --maps color, on every part"),
        (
            'mesh = "bare.obj"',
            ["--type", "metal"],
            "--maps: is color, --type metal, expected --type glossy, matte or auto beside it",
        ),
        (
            'mesh = "bare.obj"',
            ["--fidelity", "viewer"],
            "--maps: is color, --lobe taps, expected a fidelity of microfacets, such as --fidelity standard:"
            " the viewer's model is not linear in colour",
        ),
        (
            'mesh = "bare.obj"',
            ["--without", "color-map"],
            "--maps: is color, --without color-map, expected one of the two, not both",
        ),
    ],
)
def test_what_cannot_have_a_colour_map_is_refused_in_one_sentence(tmp_path, refused, mesh, words, told):
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = grey_scene(tmp_path, mesh)
    assert told in refused("fit", scene, "-o", tmp_path / "out", "--maps", "color", *words)
    assert not (tmp_path / "out").exists()


MATERIAL = '[[materials]]\nname = "default"\n{key} = "{file}"\n'


@pytest.mark.parametrize(
    ("key", "file", "told"),
    [
        ("normal_map", "none.png", "none.png, expected a file or folder that exists"),
        ("normal_map", "grey.png", "grey.png: expected a normal map in colours, not a grey height map"),
        ("normal_map", "inwards.png", "inwards.png: blue: is 0.5 or less in 100% of the texels, expected a normal map"),
        ("ambient_occlusion_map", "black.png", "black.png: expected a map of ambient occlusion that is not black"),
        (
            "ambient_occlusion_map",
            "view.exr",
            "ambient_occlusion_map: is view.exr, expected a mesh with texture coordinates (vt) to lay it over",
        ),
    ],
)
def test_given_maps_that_cannot_be_used_are_refused(tmp_path, refused, key, file, told):
    uv = "vt 0 0\nvt 1 0\nvt 0 1\n" if file != "view.exr" else ""
    face = "f 1/1 2/2 3/3" if uv else "f 1 2 3"
    (tmp_path / "bare.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{uv}{face}\n")
    for name, code in (("grey", (128, 128, 128)), ("inwards", (128, 128, 0)), ("black", (0, 0, 0))):
        iio.imwrite(tmp_path / f"{name}.png", np.broadcast_to(np.array(code, np.uint8), (4, 4, 3)))
    scene = grey_scene(tmp_path, 'mesh = "bare.obj"', MATERIAL.format(key=key, file=file))
    assert told in refused("plan", scene)


def test_a_given_map_of_ambient_occlusion_dims_the_body_by_its_values(plastic_ball, tmp_path):
    values = np.zeros((64, 64, 3), np.float32) + np.linspace(0.2, 0.9, 64, dtype=np.float32)[:, None, None]
    write_exr(tmp_path / "ao.exr", values)
    scene = tmp_path / "scene.toml"
    text = plastic_ball.read_text(encoding="utf-8")
    for name in ("its ball.obj", "environment.exr", *(f"view_{index}.exr" for index in range(4))):
        text = text.replace(f'"{name}"', f'"{plastic_ball.parent / name}"')
    scene.write_text(text + MATERIAL.format(key="ambient_occlusion_map", file="ao.exr"), encoding="utf-8")
    bare, mapped = load(plastic_ball), load(scene)
    photograph, trace = mapped.photographs[0], mapped.tracer()
    row, column = photograph.mask.nonzero()[::50].T
    surface = gbuffer.pixel_footprints(trace, photograph.camera, column, row, 1)
    clay = Matte(torch.full((3,), 0.5).double(), torch.ones(3).double())
    device, options = torch.device("cpu"), FitOptions()
    open_, dimmed = (
        lighting_for(each, options, device).pixels(surface, body=True).radiance(clay) for each in (bare, mapped)
    )
    v = surface.uv[:, 0, 1]
    expected = 0.2 + 0.7 * ((1 - v) * 64 - 0.5).clamp(0, 63) / 63  # a ramp is its own bilinear interpolation
    inside = ((1 - v) * 64 > 0.5) & ((1 - v) * 64 < 63.5)
    torch.testing.assert_close((dimmed / open_)[inside], expected[inside, None].expand(-1, 3), rtol=1e-5, atol=1e-5)


def test_a_given_normal_map_turns_the_normals_of_its_material():
    tilt = math.radians(20)
    texel = torch.tensor([math.sin(tilt), 0.0, math.cos(tilt)]) / 2 + 0.5  # towards growing u
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    up = np.array([[0.0, 0, 1]] * 4)
    mesh = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), up, corners[:, :2], np.array([0, 1]), ("a", "b"))
    trace = with_relief(gbuffer.tracer(mesh), {1: Texture(texel.expand(2, 2, 3))})
    origins = torch.tensor([[0.8, 0.2, 1], [0.2, 0.8, 1], [3, 3, 1]], dtype=torch.float64)
    found = trace(origins, torch.tensor([[0.0, 0, -1]] * 3, dtype=torch.float64))
    expected = [[0, 0, 1], [math.sin(tilt), 0, math.cos(tilt)], [0, 0, 0]]
    torch.testing.assert_close(found.normal, torch.tensor(expected, dtype=torch.float64), rtol=0, atol=1e-7)


@pytest.mark.slow
def test_relief_is_explained_by_the_normal_map_that_mitsuba_was_given(tmp_path):
    """As well as a smooth ball is; without the map it is not. Slopes are gentle: what normals see of light below the
    ball's own horizon Mitsuba hides, and a convex object of ours does not, (1 - cos 7°)/2 = 0.4 % of even light."""
    y, x = np.meshgrid(*[2 * np.pi * (np.arange(64) + 0.5) / 64] * 2, indexing="ij")
    slope = np.stack([0.12 * np.sin(6 * x), 0.12 * np.sin(4 * y), np.ones_like(x)], -1)
    normals = slope / np.linalg.norm(slope, axis=-1, keepdims=True) / 2 + 0.5
    even, mesh, white = np.full((4, 4, 3), 0.5), ball(tmp_path / "ball.obj"), diffuse((1.0, 1.0, 1.0))
    of = {"count": 2, "size": 64, "spp": 1024}
    smooth = photograph_textured(tmp_path / "smooth", mesh, even, white, **of)
    scene = photograph_textured(tmp_path / "relief", mesh, even, white, **of, normals=normals)
    write_exr(scene.parent / "relief.exr", normals.astype(np.float32))
    mapped = scene.with_name("mapped.toml")
    named = MATERIAL.format(key="normal_map", file="relief.exr")
    mapped.write_text(scene.read_text(encoding="utf-8") + named, encoding="utf-8")
    found = {
        each: fit_scene(each, tmp_path / each.stem / "out", FitOptions(PRESETS["preview"], type="matte"))
        for each in (scene, mapped)
    }
    plain = fit_scene(smooth, tmp_path / "out", FitOptions(PRESETS["preview"], type="matte"))
    left, bare, least = (each.quality.overall.rms_relative for each in (found[mapped], found[scene], plain))
    assert found[mapped].materials[0].color == pytest.approx((0.5, 0.5, 0.5), rel=0.02)
    assert left < 1.1 * least  # the same noise; 0.4 % beside 3 % in the sum of squares
    assert bare > 1.5 * least


def refitted(scene: Path, out: Path, change, radiance: float = 1.0) -> Path:
    """The result's folder of the same photographs, some times as bright, of the ball by other texture coordinates."""
    out.mkdir()
    for file in scene.parent.iterdir():
        (out / file.name).write_bytes(file.read_bytes())
    for file in out.glob("view_*.exr"):
        picture = read_image(file)
        write_exr(file, radiance * np.concatenate([picture.radiance, picture.alpha[..., None]], -1))
    lines = (out / "its ball.obj").read_text(encoding="utf-8").splitlines()
    moved = [
        "vt {:.9g} {:.9g}".format(*change(*map(float, line.split()[1:]))) if line.startswith("vt") else line
        for line in lines
    ]
    (out / "its ball.obj").write_text("\n".join(moved), encoding="utf-8")
    fit_scene(out / "scene.toml", out / "result", FitOptions(PRESETS["preview"], type="matte", maps=("color",)))
    return out / "result"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        pytest.param(lambda u, v: (1e-6 * u, 1e-6 * v), "no pixel separates texels", marks=pytest.mark.slow),
        pytest.param(lambda u, v: (500 * u, 500 * v), "no pixel separates texels", marks=pytest.mark.slow),
        (lambda u, v: (u, u), "no texture coordinates, or such as cover no area"),
    ],
)
def test_texture_coordinates_that_tell_nothing_leave_the_colour_open(plastic_ball, tmp_path, change, told):
    result = read_result(refitted(plastic_ball, tmp_path / "changed", change) / "result.json")
    assert told in result.message
    assert result.materials[0].maps is None
    assert result.materials[0].determined.color == (False, False, False)


def test_places_that_share_texels_are_told(plastic_ball, tmp_path):
    folder = refitted(plastic_ball, tmp_path / "changed", lambda u, v: (3 * u, 2 * v))
    # 3 · 2 faces meet every texel, but for one of two of the quads about either pole, whose faces have no area: 5.75
    assert "5.8 places of the surface share a texel" in read_result(folder / "result.json").message


def test_colours_above_one_are_cut_and_told_and_intervals_are_those_of_the_numbers(plastic_ball, tmp_path):
    result = read_result(refitted(plastic_ball, tmp_path / "changed", lambda u, v: (u, v), 3.0) / "result.json")
    assert "would have to be far above 1" in result.message
    (material,) = result.materials
    assert material.determined.color == (False, False, False)
    for value, (low, high) in zip(material.color, material.interval95.color, strict=True):
        assert low <= value <= high
        assert f"{low:.3g}…{high:.3g}" in result.message


@pytest.mark.slow  # poses, a fit, and its texture
def test_poses_of_a_textured_object_are_mended_by_its_outlines_alone(plastic_ball, tmp_path):
    options = FitOptions(PRESETS["preview"], type="glossy", maps=("color",), refine_pose=True)
    result = fit_scene(plastic_ball, tmp_path / "out", options)
    assert "to where outlines agree" in result.message
    assert result.cameras is not None
    for camera in result.cameras:  # which stand where they should: the texture moved them by three or four errors
        assert camera.degrees < 2.5 * camera.stderr_degrees
        assert camera.percent < 2.5 * camera.stderr_percent
