"""Photographs that `synth` makes in the viewer's own model, against closed forms of MODEL.md 3 and 4."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fit_material.renderer.environment.environment import directions
from fit_material.renderer.geometry.mesh import Sphere, read_mesh
from fit_material.renderer.images.image_file import read_image, write_exr
from fit_material.renderer.materials.ground_truth import TrueGlossy, TrueMaterial, TrueMatte, TrueMetal
from fit_material.renderer.scene.lights import DirectionalLightSpec
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from tests.support import solids
from tests.support.solids import CLAY, COLORS, GOLD, KEYS, NAMES, SIZE, ball_seen, grey_map, materials_seen, truth_of


@pytest.fixture(scope="module")
def grey_file(tmp_path_factory) -> str:
    return grey_map(tmp_path_factory.mktemp("grey"))


@pytest.fixture(scope="module")
def octahedron(tmp_path_factory) -> Path:
    return solids.octahedron(tmp_path_factory.mktemp("octahedron"))


def schlick(n_dot_v: np.ndarray, f0: Sequence[float]) -> np.ndarray:
    return np.array(f0) + (1 - np.array(f0)) * (1 - n_dot_v[..., None]) ** 5


def under_grey_light(material: TrueMaterial, n_dot_v: np.ndarray) -> np.ndarray:
    """What the thesis's materials show under radiance 1 from everywhere [MODEL.md 4]."""
    if isinstance(material, TrueMetal):
        index = np.array(material.n) + 1j * np.array(material.k)
        return schlick(n_dot_v, np.abs((index - 1) / (index + 1)) ** 2)
    f, color = schlick(n_dot_v, material.reflectance), np.array(material.color)
    if isinstance(material, TrueMatte):
        return color * f
    return color / np.maximum(1, (color / (1 - f)).max(-1, keepdims=True)) + f


VIEWERS = [
    replace(GOLD, alpha=None, roughness=0.3),
    TrueGlossy((0.7, 0.2, 0.1), (0.04, 0.1, 0.35), roughness=0.2),
    TrueMatte((0.7, 0.2, 0.1), (0.3, 0.5, 1.0)),
]


@pytest.mark.parametrize("material", VIEWERS)
def test_the_viewers_photographs_follow_the_thesis(material, grey_file, tmp_path):
    truth = truth_of(tmp_path, SynthOptions(material, model="viewer", env=grey_file, size=SIZE, views=2))
    for index, view in enumerate(views(2, Sphere())):
        photograph = read_image(tmp_path / f"view_{index}.exr")
        _, n_dot_v, _ = ball_seen(view.camera(SIZE))
        covered = np.isfinite(n_dot_v)
        assert photograph.alpha is not None
        np.testing.assert_array_equal(photograph.alpha, covered)
        expected = under_grey_light(material, n_dot_v[covered])
        # float32 of the lookups and of the file; weights of 49 taps that add up to 1
        np.testing.assert_allclose(photograph.radiance[covered], expected, rtol=3e-6)
    (entry,) = truth["materials"]
    assert " ".join(entry) == KEYS
    assert (entry["alpha"], entry["roughness"]) == (None, getattr(material, "roughness", None))
    assert (truth["model"], truth["mitsuba"], truth["spp"]) == ("viewer", None, None)


@pytest.mark.parametrize("roughness", [0.0, 0.5])
def test_the_viewers_roughness_blurs_what_lies_in_the_mirrored_direction(roughness, tmp_path):
    """Under the sky L(ω) = 1 + ω/2 the 49 taps leave 1 + m r/2: across r they cancel [MODEL.md 3.1]."""
    sky = tmp_path / "sky.exr"
    write_exr(sky, (1 + directions(128, 256) / 2).float().numpy())
    metal = replace(GOLD, alpha=None, roughness=roughness)
    synthesise(SynthOptions(metal, model="viewer", env=str(sky), size=SIZE, views=1), tmp_path)
    _, n_dot_v, reflected = ball_seen(views(1, Sphere())[0].camera(SIZE))
    covered = np.isfinite(n_dot_v)
    tap = np.arange(-3, 4)
    weight = np.exp(-0.5 * (tap / 1.5) ** 2)
    cosine = 1 / np.sqrt(1 + roughness**2 * (tap[:, None] ** 2 + tap**2) / 9)
    shrunk = (weight[:, None] * weight * cosine).sum() / weight.sum() ** 2
    expected = under_grey_light(metal, n_dot_v[covered]) * (1 + shrunk * reflected[covered] / 2)
    shown = read_image(tmp_path / "view_0.exr").radiance[covered]
    # bilinear between texels of 1.4°: (π/128)²/8 · ½, once for the map and once for the cube made of it
    np.testing.assert_allclose(shown, expected, atol=2e-4)


def test_the_viewer_shows_each_side_made_of_its_material(octahedron, grey_file, tmp_path):
    material = {name: TrueMatte(color) for name, color in zip(NAMES, COLORS, strict=True)}
    synthesise(SynthOptions(material, model="viewer", mesh=octahedron, env=grey_file, size=SIZE, views=1), tmp_path)
    radiance = read_image(tmp_path / "view_0.exr").radiance
    seen = materials_seen(views(1, read_mesh(octahedron))[0].camera(SIZE))
    assert set(seen.flat) == {-1, 0, 1, 2}
    np.testing.assert_allclose(radiance[seen >= 0], np.array(COLORS)[seen[seen >= 0]], rtol=3e-6)


def test_a_light_shines_on_the_viewers_photographs(grey_file, tmp_path):
    """E of MODEL.md 4 is the irradiance over π, so that Mitsuba's matte ball looks alike."""
    light = DirectionalLightSpec(type="directional", direction=(0.0, 2.0, 0.0), irradiance=(math.pi, 0.0, 0.0))
    options = SynthOptions(CLAY, model="viewer", env=grey_file, lights=(light,), size=SIZE, views=1)
    synthesise(options, tmp_path)
    radiance = read_image(tmp_path / "view_0.exr").radiance
    normal, n_dot_v, _ = ball_seen(views(1, Sphere())[0].camera(SIZE))
    covered = np.isfinite(n_dot_v)
    facing_up = np.clip(normal[covered][:, 1:2], 0, None)
    expected = np.array(CLAY.color) * (1 + facing_up * [1.0, 0.0, 0.0])
    np.testing.assert_allclose(radiance[covered], expected, rtol=1e-5)
    assert facing_up.max() > 0.5
