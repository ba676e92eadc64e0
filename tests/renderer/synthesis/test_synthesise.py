"""Rendered photographs against closed forms, and the folder that `synthesise` writes."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
import torch

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh, Sphere
from fit_material.renderer.images.image_file import read_image, write_exr
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.materials.ground_truth import TrueMetal
from fit_material.renderer.mitsuba.conversion import mitsuba, variant_here
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.scene.scene_file import camera_of, read_scene, read_shape
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from fit_material.shaders.optics.fresnel import conductor as fresnel_conductor

SIZE = 24
SPECULAR = 0.001  # alpha of all but a mirror
PERFECT = conductor((1e-4,) * 3, (10.0,) * 3, SPECULAR)  # absorbs 4n/[(n+1)² + k²] = 4e-6
GOLD = {"n": (0.146, 0.425, 1.431), "k": (3.578, 2.326, 1.85)}
DULL_GOLD = TrueMetal(**GOLD, alpha=0.2)


@pytest.fixture(params=["scalar_rgb", "llvm_ad_rgb"])
def variant(request):
    try:
        mitsuba(request.param)
    except InputError:
        pytest.skip("no LLVM on this machine")
    yield request.param
    mitsuba("scalar_rgb")


def constant(radiance: float) -> Environment:
    return Environment(torch.full((8, 16, 3), radiance))


def orthographic() -> Camera:
    pose = look_at(*map(torch.tensor, ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [0.1, 1.0, 0.0])))
    return Camera(pose, SIZE, SIZE, "orthographic", scale=1.1)


def mirrored(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Per pixel centre of an orthographic camera: n·v, and the mirrored view direction."""
    row, column = torch.meshgrid(torch.arange(SIZE) + 0.5, torch.arange(SIZE) + 0.5, indexing="ij")
    origin, along = (v.numpy() for v in camera.rays(column, row))
    across = origin - (origin * along).sum(-1, keepdims=True) * along
    n_dot_v = np.sqrt(np.clip(1 - (across**2).sum(-1), 0, None))
    normal = across - n_dot_v[..., None] * along
    return n_dot_v, along + 2 * n_dot_v[..., None] * normal


def assert_mirrored(pixels: np.ndarray, expected: np.ndarray, spp: int) -> None:
    """Pixels as expected but for the light samples that happen to meet the mirror's narrow lobe.

    Such a sample weighs at most 1/spp and is rare: 4 of them in a pixel, and none that shows in the mean.
    """
    np.testing.assert_allclose(pixels, expected, atol=4 * expected.max() / spp)
    assert pixels.mean() == pytest.approx(expected.mean(), rel=3e-3)


def test_a_perfect_mirror_vanishes_in_a_furnace():
    pixels = render(Sphere(), orthographic(), constant(1.0), PERFECT, spp=64)
    assert_mirrored(pixels[..., :3], np.broadcast_to(pixels[..., 3:], (SIZE, SIZE, 3)), spp=64)


def given_back(alpha: float, distribution: str) -> float:
    """Share of a perpendicular ray that a perfect metal's single bounce gives back: ∫ G1(2θm) du, 2θm < 90°.

    θm is drawn from D(m) cos θm, GGX tan² θm = α²u/(1-u), Beckmann tan² θm = -α² ln(1-u)  [Walter 2007, eqs.
    28, 35]; what leaves at 2θm is masked by Smith's G1 [eqs. 27, 34].
    """
    u = (np.arange(20_000) + 0.5) / 20_000
    tan_m = alpha * np.sqrt(u / (1 - u) if distribution == "ggx" else -np.log1p(-u))
    tan_m = tan_m[tan_m < 1]
    width = alpha * 2 * tan_m / (1 - tan_m**2)  # α tan 2θm
    if distribution == "ggx":
        g1 = 2 / (1 + np.sqrt(1 + width**2))
    else:
        a = torch.tensor(1 / width)
        g1 = (2 / (1 + a.erf() + torch.exp(-(a**2)) / (a * math.sqrt(math.pi)))).numpy()
    return g1.sum() / u.size


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize("alpha", [0.1, 0.5])
def test_a_rough_metal_in_a_furnace_loses_what_theory_says(alpha, distribution):
    upright = look_at(*map(torch.tensor, ([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])))
    close_up = Camera(upright, SIZE, SIZE, "orthographic", scale=0.02)  # the ball is flat here, and faces us
    bsdf = conductor((1e-4,) * 3, (10.0,) * 3, alpha, distribution)
    pixels = render(Sphere(), close_up, constant(1.0), bsdf, spp=64)[..., 0]
    error = float(pixels.std()) / math.sqrt(pixels.size)
    # 4 σ; Mitsuba's Beckmann uses Walter's rational fit of G1, good to 0.35 %
    assert float(pixels.mean()) == pytest.approx(given_back(alpha, distribution), abs=4 * error + 0.0035)


def test_a_mirror_under_an_even_sky_shows_its_reflectance():
    bsdf, sky = conductor(GOLD["n"], GOLD["k"], SPECULAR), 3.0
    pixels = render(Sphere(), orthographic(), constant(sky), bsdf, spp=64)
    n_dot_v, _ = mirrored(orthographic())
    inside = n_dot_v > 0.5  # there F is so even that the pixel's centre stands for the pixel
    n, k = (torch.tensor(GOLD[name], dtype=torch.float64) for name in "nk")
    expected = sky * fresnel_conductor(torch.tensor(n_dot_v[inside])[:, None], n, k).numpy()
    for channel in range(3):
        assert_mirrored(pixels[inside, channel], expected[:, channel], spp=64)


def test_a_mirror_shows_what_lies_in_the_mirrored_direction(variant):
    """Under the sky L(ω) = 1 + ω/2 each pixel spells its reflected direction: camera and map at once."""
    sky = Environment((1 + directions(128, 256) / 2).float())
    pixels = render(Sphere(), orthographic(), sky, PERFECT, spp=64, variant=variant)
    n_dot_v, reflected = mirrored(orthographic())
    inside = n_dot_v > 0.5
    for axis in range(3):
        assert_mirrored(pixels[inside, axis], 1 + reflected[inside, axis] / 2, spp=64)


def test_the_ball_covers_the_disc_that_geometry_says():
    view = views(1, Sphere(), fov=35.0)[0]
    pixels = render(Sphere(), view.camera(SIZE), constant(1.0), PERFECT, spp=64)
    distance = np.linalg.norm(view.origin)
    radius = SIZE / 2 * math.tan(math.asin(1 / distance)) / math.tan(math.radians(35 / 2))
    # a rim of 2πr pixels is sampled 64 times each, with a standard deviation of at most ½: 4 σ
    tolerance = 4 * 0.5 / math.sqrt(64) * math.sqrt(2 * math.pi * radius)
    assert pixels[..., 3].sum() == pytest.approx(math.pi * radius**2, abs=tolerance)


def blob(scale: float, offset: float) -> Mesh:
    vertices = scale * np.random.default_rng(2).normal(size=(40, 3)) + offset
    faces = np.arange(39).reshape(13, 3)  # the last vertex belongs to no face
    vertices[39] = 1e6
    return Mesh(vertices, faces, None, None, np.zeros(13, dtype=int))


@pytest.mark.parametrize("shape", [Sphere(), blob(0.01, 0.5), blob(300, -1e4)])
def test_every_view_sees_the_whole_object_large(shape):
    points = np.eye(3) if isinstance(shape, Sphere) else shape.vertices[:39]
    for view in views(7, shape, fov=50.0):
        pose = view.camera(SIZE).camera_to_world.numpy()
        x, y, z = np.linalg.inv(pose)[:3, :3] @ (points - pose[:3, 3]).T
        assert (z < 0).all()
        spread = np.maximum(np.abs(x), np.abs(y)) / -z / math.tan(math.radians(25))
        assert 0.3 < spread.max() < 1


@pytest.mark.parametrize("count", [2, 3, 100])
def test_no_two_views_are_alike(count):
    origins = np.array([view.origin for view in views(count, Sphere())])
    apart = np.linalg.norm(origins[:, None] - origins[None], axis=-1)[~np.eye(count, dtype=bool)]
    assert apart.min() > 0.1


@pytest.fixture(scope="module")
def sky(tmp_path_factory) -> Path:
    """A file with a small map of noise."""
    path = tmp_path_factory.mktemp("sky") / "sky.exr"
    write_exr(path, np.random.default_rng(1).uniform(0.1, 1, (16, 32, 3)).astype(np.float32))
    return path


@pytest.fixture
def small(sky):
    """Options of a small and quick run of gold, with changes."""

    def options(material=DULL_GOLD, **changes) -> SynthOptions:
        quick = {"views": 2, "size": SIZE, "spp": 4, "fov": 40.0, "env": str(sky)}
        return SynthOptions(material, **{**quick, **changes})

    return options


def test_the_scene_reads_back_as_the_cameras_that_rendered_it(tmp_path, small):
    path = synthesise(small(views=3), tmp_path / "out")
    scene = read_scene(path)
    assert isinstance(read_shape(scene.geometry), Sphere)
    for photograph, view in zip(scene.photographs, views(3, Sphere(), 40.0), strict=True):
        found, expected = camera_of(photograph.camera, SIZE, SIZE), view.camera(SIZE)
        assert torch.equal(found.camera_to_world, expected.camera_to_world)  # bitwise
        assert (found.projection, found.fov) == (expected.projection, expected.fov)


def test_the_written_map_is_the_one_that_lit_the_photographs(tmp_path, small, sky):
    synthesise(small(), tmp_path)
    written, lit = (read_environment(path).radiance for path in (tmp_path / "environment.exr", sky))
    assert torch.equal(written, lit)


def test_the_studio_is_the_default_light(tmp_path):
    synthesise(SynthOptions(DULL_GOLD, views=1, size=8, spp=1), tmp_path)
    assert torch.equal(read_environment(tmp_path / "environment.exr").radiance, studio().radiance)


def test_truth_says_what_mitsuba_really_held(tmp_path, small):
    synthesise(small(TrueMetal(**GOLD, alpha=0.2, metal="Au", source="a book")), tmp_path)
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    material = truth["materials"][0]
    assert truth["format"] == 1
    assert (material["metal"], material["source"], material["alpha"]) == ("Au", "a book", 0.2)
    assert truth["spectra"]["eta"] == pytest.approx(GOLD["n"], rel=1e-6)
    assert truth["spectra"]["k"] == pytest.approx(GOLD["k"], rel=1e-6)
    for n, k, f0 in zip(material["n"], material["k"], material["f0"], strict=True):
        assert f0 == pytest.approx(abs((n + 1j * k - 1) / (n + 1j * k + 1)) ** 2, rel=1e-12)


def test_truth_says_which_variant_took_the_photographs(tmp_path, small, variant):
    for asked in (variant, "auto"):
        synthesise(small(variant=asked), tmp_path)
        used = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))["variant"]
        assert used == (variant if asked == variant else variant_here())


def test_a_mesh_travels_with_its_scene(tmp_path, small):
    name = 'tetra "édition" 2.obj'
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / name).write_text(text)
    path = synthesise(small(mesh=tmp_path / name), tmp_path / "out")
    assert tomllib.loads(path.read_text(encoding="utf-8"))["geometry"]["mesh"] == name
    assert (path.parent / name).read_text() == text
    shape = read_shape(read_scene(path).geometry)
    assert isinstance(shape, Mesh)
    assert len(shape.faces) == 4


def photographs(folder) -> list[bytes]:
    return [path.read_bytes() for path in sorted(folder.glob("view_*.exr"))]


def test_the_seed_reproduces_every_byte_and_another_does_not(tmp_path, small):
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        synthesise(small(seed=seed, noise=0.02), tmp_path / name)
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert names == sorted(["environment.exr", "scene.toml", "truth.json", "view_0.exr", "view_1.exr"])
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert not set(photographs(tmp_path / "a")) & set(photographs(tmp_path / "c"))


def test_noise_is_relative_and_as_strong_as_asked(tmp_path, small):
    strength = 0.03
    synthesise(small(views=1, size=48), tmp_path / "clean")
    synthesise(small(views=1, size=48, noise=strength), tmp_path / "noisy")
    clean, noisy = (read_image(tmp_path / name / "view_0.exr") for name in ("clean", "noisy"))
    np.testing.assert_array_equal(clean.alpha, noisy.alpha)
    lit = clean.radiance > 0
    factor = noisy.radiance[lit] / clean.radiance[lit] - 1
    assert factor.size > 3000
    assert factor.mean() == pytest.approx(0, abs=4 * strength / math.sqrt(factor.size))  # 4 σ of a mean
    assert factor.std() == pytest.approx(strength, abs=4 * strength / math.sqrt(2 * factor.size))  # 4 σ of a σ


def test_progress_counts_up_to_the_end(tmp_path, small):
    told = []
    synthesise(small(), tmp_path, lambda what, share: told.append((what, share)))
    assert told[0] == ("environment", 0.0)
    assert told[-1] == ("photograph 2 of 2", 1.0)
    shares = [share for _, share in told]
    assert shares == sorted(shares)


def test_an_interrupted_run_leaves_the_old_result_whole(tmp_path, small):
    synthesise(small(seed=1), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def interrupt(what: str, share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        synthesise(small(seed=2), tmp_path, interrupt)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("change", "option"),
    [
        ({"model": "pbrt"}, "--model"),
        ({"views": 0}, "--views"),
        ({"views": 1001}, "--views"),
        ({"size": 7}, "--size"),
        ({"spp": 0}, "--spp"),
        ({"noise": -0.1}, "--noise"),
        ({"noise": math.nan}, "--noise"),
        ({"seed": -1}, "--seed"),
        ({"fov": 180.0}, "--fov"),
        ({"max_depth": 1}, "--max-depth"),
    ],
)
def test_a_value_out_of_range_names_its_option(change, option, small):
    with pytest.raises(InputError, match=f"^{option}: is .* expected "):
        small(**change)


def test_a_map_that_is_missing_is_an_input_error(tmp_path, small):
    with pytest.raises(InputError, match=r"nowhere\.hdr"):
        synthesise(small(env="nowhere.hdr"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_view_is_made_of_plain_floats():
    view = views(1, Sphere())[0]
    assert all(type(value) is float for value in (*view.origin, *view.target, *view.up, view.fov))
