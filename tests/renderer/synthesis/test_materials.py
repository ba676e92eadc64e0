"""Ground truth of every kind of material: what Mitsuba makes of it against closed forms, and what is written down."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh, Sphere, read_mesh
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.materials.bsdf import diffuse, plastic
from fit_material.renderer.materials.ground_truth import TrueGlossy, TrueMatte, TrueMetal
from fit_material.renderer.mitsuba.conversion import bsdf_of, mitsuba
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.scene.lights import DirectionalLightSpec, directional_light
from fit_material.renderer.scene.scene_file import read_scene, read_shape
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from fit_material.shaders.optics.fresnel import conductor
from tests.support import solids
from tests.support.solids import CLAY, COLORS, GOLD, KEYS, NAMES, RED, SIZE, grey_map, materials_seen, truth_of


@pytest.fixture(scope="module")
def mi():
    return mitsuba("scalar_rgb")


def grey(radiance: float = 1.0) -> Environment:
    return Environment(torch.full((8, 16, 3), radiance))


@pytest.fixture(scope="module")
def grey_file(tmp_path_factory) -> str:
    return grey_map(tmp_path_factory.mktemp("grey"))


@pytest.fixture(scope="module")
def octahedron(tmp_path_factory) -> Path:
    return solids.octahedron(tmp_path_factory.mktemp("octahedron"))


def orthographic(size: int = SIZE, scale: float = 1.1) -> Camera:
    pose = look_at(*map(torch.tensor, ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [0.1, 1.0, 0.0])))
    return Camera(pose, size, size, "orthographic", scale=scale)


def normals(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Of the unit sphere at the centres of an orthographic camera's pixels, and n·v there; n·v = 0 beside it."""
    row, column = torch.meshgrid(torch.arange(SIZE) + 0.5, torch.arange(SIZE) + 0.5, indexing="ij")
    origin, along = (v.numpy() for v in camera.rays(column, row))
    across = origin - (origin * along).sum(-1, keepdims=True) * along
    n_dot_v = np.sqrt(np.clip(1 - (across**2).sum(-1), 0, None))
    return across - n_dot_v[..., None] * along, n_dot_v


def facing(mi):
    """An interaction that is looked at from straight above."""
    interaction = mi.SurfaceInteraction3f()
    interaction.wi = mi.Vector3f(0, 0, 1)
    return interaction


@given(reflectance=st.floats(1e-4, 0.18))
def test_smooth_plastic_mirrors_its_reflectance_at_normal_incidence(mi, reflectance):
    bsdf = mi.load_dict(plastic((0.0, 0.0, 0.0), reflectance, 0.0))
    sample, weight = bsdf.sample(mi.BSDFContext(), facing(mi), 0.0, mi.Point2f(0.5))
    # η - 1 >= 0.02 is held in float32: its square within 2 · 6e-8 · η/(η - 1)
    np.testing.assert_allclose(sample.pdf * np.array(weight), reflectance, rtol=1e-5)


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@settings(max_examples=12)  # Mitsuba tabulates transmittances anew for each
@given(reflectance=st.floats(1e-4, 0.99), alpha=st.floats(0.01, 1.0))
def test_rough_plastic_has_its_reflectance_at_normal_incidence(mi, distribution, reflectance, alpha):
    """Straight back the lobe is F0 D(0)/4, with D(0) = 1/(πα²) for either distribution [Walter 2007]."""
    bsdf = mi.load_dict(plastic((0.0, 0.0, 0.0), reflectance, alpha, distribution))
    lobe = np.array(bsdf.eval(mi.BSDFContext(), facing(mi), mi.Vector3f(0, 0, 1)))
    # float32 as above, in η, in 1 - √F0 > 0.005, and in α²
    np.testing.assert_allclose(lobe * 4 * math.pi * alpha**2, reflectance, rtol=2e-5)


def test_a_matte_ball_in_a_furnace_gives_back_its_color():
    pixels = render(Sphere(), orthographic(), grey(2.0), bsdf_of(CLAY), spp=64)
    covered = pixels[..., 3] == 1
    shown = pixels[covered, :3] / 2
    for channel, color in enumerate(CLAY.color):
        error = float(shown[:, channel].std()) / math.sqrt(covered.sum())
        assert shown[:, channel].mean() == pytest.approx(color, abs=4 * error)  # 4 σ of the mean
        assert error < 0.003


@pytest.mark.parametrize(("metal", "expected"), [(replace(GOLD, alpha=0.0), conductor)])
def test_a_metal_of_no_alpha_is_a_mirror(metal, expected):
    pixels = render(Sphere(), orthographic(), grey(3.0), bsdf_of(metal), spp=16)
    _, n_dot_v = normals(orthographic())
    inside = n_dot_v > 0.5  # there F is so even that the pixel's centre stands for the pixel
    n, k = (torch.tensor(index, dtype=torch.float64) for index in (metal.n, metal.k))
    reflected = 3 * expected(torch.tensor(n_dot_v[inside])[:, None], n, k).numpy()
    # a mirror has no noise; within a pixel n·v changes by 0.16 at most here, and F by up to 0.1 times that
    np.testing.assert_allclose(pixels[inside, :3], reflected, atol=3 * 0.016)
    assert pixels[inside, :3].mean() == pytest.approx(reflected.mean(), rel=2e-3)


def test_a_directional_light_gives_its_irradiance_where_it_faces():
    towards, irradiance, sky = np.array([2.0, -1.0, 2.0]) / 3, np.array([3.0, 2.0, 1.0]), 0.05
    spec = DirectionalLightSpec(type="directional", direction=(20.0, -10.0, 20.0), irradiance=(3.0, 2.0, 1.0))
    light = directional_light(spec)
    pixels = render(Sphere(), orthographic(), grey(sky), bsdf_of(CLAY), lights=[light], spp=256)
    normal, n_dot_v = normals(orthographic())
    n_dot_l = (normal * towards).sum(-1)[..., None]
    direct = np.array(CLAY.color) * irradiance / math.pi * np.clip(n_dot_l, 0, None)
    expected = direct + np.array(CLAY.color) * sky
    inside = n_dot_v > 0.4
    assert (n_dot_l[inside] < -0.3).any()  # some of it lies in the shadow
    # each sample asks map or light by the toss of a coin, and counts it twice: a deviation of 1/√256 of the light's
    # part. Within a pixel, 0.09 of the plane, the normal turns by 0.23 at n·v = 0.4: over 256 positions 0.23/√12/16
    deviation = direct / 16 + 0.3 * sky / 16 + 0.004
    assert (np.abs(pixels[..., :3] - expected) < 5 * deviation)[inside].all()
    error = float(np.sqrt((deviation[inside] ** 2).sum(0)).max()) / inside.sum()
    np.testing.assert_allclose(pixels[inside, :3].mean(0), expected[inside].mean(0), atol=4 * error)


def test_each_side_shows_the_material_that_the_file_names(octahedron, grey_file, tmp_path):
    material = {name: TrueMatte(color) for name, color in zip(reversed(NAMES), reversed(COLORS), strict=True)}
    options = SynthOptions(material, mesh=octahedron, env=grey_file, size=SIZE, views=3, spp=16)
    path = synthesise(options, tmp_path)
    shape = read_mesh(octahedron)
    seen = set()
    for index, view in enumerate(views(3, shape)):
        radiance = read_image(tmp_path / f"view_{index}.exr").radiance
        expected = materials_seen(view.camera(SIZE))
        for material_index in set(expected[expected >= 0].tolist()):
            shown, color = radiance[expected == material_index], np.array(COLORS[material_index])
            brightness = (shown / color).mean(-1)
            error = brightness.std() / math.sqrt(len(brightness))
            assert brightness.mean() == pytest.approx(1, abs=4 * error + 1e-3)  # 4 σ of the mean
            # whatever the noise of a pixel, under grey light its hue is the body's: float32, and the file's
            np.testing.assert_allclose(shown / brightness[:, None], np.broadcast_to(color, shown.shape), rtol=1e-4)
            seen.add(material_index)
    assert seen == {0, 1, 2}
    found = read_shape(read_scene(path).geometry)
    assert isinstance(found, Mesh)
    assert found.material_names == shape.material_names
    entries = json.loads((tmp_path / "truth.json").read_text())["materials"]
    assert [entry["name"] for entry in entries] == [*shape.material_names]
    assert {entry["name"]: tuple(entry["color"]) for entry in entries} == dict(zip(NAMES, COLORS, strict=True))


def corner_of_a_room() -> Mesh:
    """A white floor and, of another material, a wall at its edge."""
    floor = [[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]]
    wall = [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]]
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    return Mesh(np.array(floor + wall, float), faces, None, None, np.array([0, 0, 1, 1]), ("floor", "wall"))


def test_materials_light_each_other():
    """The floor under a grey sky is grey, but for the light that the red wall gives it."""
    pose = look_at(*map(torch.tensor, ([0.5, 5.0, 0.5], [0.5, 0.0, 0.5], [0.0, 0.0, -1.0])))
    camera = Camera(pose, 8, 8, "orthographic", scale=0.45)
    bsdfs = [diffuse((0.8, 0.8, 0.8)), diffuse((0.9, 0.0, 0.0))]
    alone, together = (
        render(corner_of_a_room(), camera, grey(), bsdfs, spp=64, max_depth=depth)[..., :3] for depth in (2, 3)
    )
    np.testing.assert_allclose(alone[..., 0], alone[..., 1], rtol=1e-5)
    np.testing.assert_allclose(together[..., 1], together[..., 2], rtol=1e-5)
    redder = (together[..., 0] - together[..., 1]).mean(0)
    assert (redder > 0).all()
    # a differential floor sees of a wall on its edge, along its middle line, a share F; the wall sees half the sky
    near, far = redder[0], redder[-1]
    assert near > 2 * far


MATERIALS = [
    GOLD,
    replace(GOLD, alpha=0.0),
    RED,
    replace(RED, alpha=0.0),
    replace(RED, distribution="beckmann"),
    CLAY,
]


@pytest.mark.parametrize("material", MATERIALS)
def test_the_truth_is_written_and_is_what_mitsuba_holds(material, grey_file, tmp_path):
    truth = truth_of(tmp_path, SynthOptions(material, env=grey_file, size=8, views=1, spp=1))
    (entry,) = truth["materials"]
    assert " ".join(entry) == KEYS
    assert (entry["name"], entry["type"], entry["roughness"], truth["model"]) == (
        "default",
        material.type,
        None,
        "mitsuba",
    )
    for key in ("n", "k", "color", "reflectance", "alpha"):
        value = getattr(material, key, None)
        assert entry[key] == (list(value) if isinstance(value, tuple) else value)
    assert entry["distribution"] == (material.distribution if entry["alpha"] else None)
    held = entry["held"]
    if material.type == "metal":
        assert held["eta"] == pytest.approx(entry["n"], rel=1e-6)
        assert held["k"] == pytest.approx(entry["k"], rel=1e-6)
        assert truth["spectra"] == {"eta": held["eta"], "k": held["k"]}
    elif material.type == "glossy":
        (index,) = held["eta"]
        assert entry["f0"] == entry["reflectance"]
        assert ((index - 1) / (index + 1)) ** 2 == pytest.approx(entry["f0"][0], rel=1e-5)
        assert held["diffuse_reflectance"] == pytest.approx(entry["color"], rel=1e-6)
    else:
        assert held == {"reflectance": pytest.approx(entry["color"], rel=1e-6)}
        assert (entry["f0"], entry["reflectance"], truth["spectra"]) == (None, [1, 1, 1], None)
    assert held.get("alpha", [0]) == pytest.approx([entry["alpha"] or 0], rel=1e-6)


def test_one_material_for_all_stands_under_every_name(octahedron, grey_file, tmp_path):
    truth = truth_of(tmp_path, SynthOptions(RED, mesh=octahedron, env=grey_file, size=8, views=1, spp=1))
    assert {entry.pop("name") for entry in truth["materials"]} == set(NAMES)
    assert truth["materials"][0] == truth["materials"][1] == truth["materials"][2]


def test_a_light_is_written_into_the_scene(grey_file, tmp_path):
    light = DirectionalLightSpec(type="directional", direction=(0.3, 0.8, 0.5), irradiance=(3.0, 3.0, 2.8))
    path = synthesise(SynthOptions(CLAY, env=grey_file, lights=(light,), size=8, views=1, spp=1), tmp_path)
    assert read_scene(path).lights == (light,)


THREE = (0.1, 0.2, 0.3)


@pytest.mark.parametrize(
    ("make", "option"),
    [
        (lambda: TrueMetal((0.0, 1.0, 1.0), THREE), "--n"),
        (lambda: TrueMetal((1.0, math.nan, 1.0), THREE), "--n"),
        (lambda: TrueMetal(THREE, (1.0, 1.0, -0.1)), "--k"),
        (lambda: TrueMetal(THREE, (math.inf, 1.0, 1.0)), "--k"),
        (lambda: TrueMetal(THREE, THREE, 0.0005), "--alpha"),
        (lambda: TrueMetal(THREE, THREE, -0.1), "--alpha"),
        (lambda: TrueMetal(THREE, THREE, math.nan), "--alpha"),
        (lambda: TrueGlossy(THREE, THREE, 1.01), "--alpha"),
        (lambda: TrueGlossy(THREE, THREE, roughness=-1.0), "--roughness"),
        (lambda: TrueGlossy(THREE, THREE, roughness=math.nan), "--roughness"),
        (lambda: TrueMetal(THREE, THREE, 0.1, distribution="phong"), "--distribution"),  # type: ignore[arg-type]
        (lambda: TrueGlossy((0.1, 0.2, 1.01), THREE), "--color"),
        (lambda: TrueMatte((-0.1, 0.2, 1.0)), "--color"),
        (lambda: TrueMatte((math.nan, 0.2, 1.0)), "--color"),
        (lambda: TrueGlossy(THREE, (0.1, 0.1, 1.1)), "--reflectance"),
    ],
)
def test_a_number_out_of_range_names_its_option(make, option):
    with pytest.raises(InputError, match=f"^{option}: is .* expected "):
        make()


def all_of(value: float) -> tuple[float, float, float]:
    return (value, value, value)


@pytest.mark.parametrize(
    ("material", "model", "option"),
    [
        (replace(GOLD, alpha=None), "mitsuba", "--alpha: expected"),
        (replace(GOLD, roughness=0.3), "mitsuba", "--roughness: is 0.3, expected --alpha"),
        (GOLD, "viewer", "--alpha: is 0.2, expected --roughness"),
        (replace(RED, alpha=None), "viewer", "--roughness: expected"),
        (replace(RED, reflectance=(0.04, 0.04, 0.05)), "mitsuba", "--reflectance: is .* three equal numbers"),
        (replace(RED, reflectance=all_of(0.0)), "mitsuba", "--reflectance: is"),
        (replace(RED, reflectance=all_of(1.0)), "mitsuba", "--reflectance: is"),
        (replace(RED, reflectance=all_of(0.2), alpha=0.0), "mitsuba", "--reflectance: is .* at most 0.18"),
        (TrueMatte(THREE, all_of(0.5)), "mitsuba", "--reflectance: is .* Lambertian"),
    ],
)
def test_a_material_that_the_model_cannot_show_is_refused(material, model, option):
    with pytest.raises(InputError, match=f"^{option}"):
        SynthOptions(material, model=model)


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ((*NAMES, "lid"), "^--materials: is lid, expected a material that the mesh has: .*warm"),
        (NAMES[:2], "^--materials: expected an entry for cold"),
    ],
)
def test_the_materials_are_those_of_the_mesh(names: Sequence[str], sentence, octahedron, grey_file, tmp_path):
    options = SynthOptions(dict.fromkeys(names, CLAY), mesh=octahedron, env=grey_file, size=8, views=1, spp=1)
    with pytest.raises(InputError, match=sentence):
        synthesise(options, tmp_path / "out")
    assert not (tmp_path / "out").exists()
