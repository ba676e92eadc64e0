"""Scenes of every type of material, whole: photographs by Mitsuba or the viewer's model, a fit that is told nothing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.fitter.result.schema import FittedMaterial, Result
from fit_material.renderer.materials.ground_truth import TrueGlossy, TrueMaterial, TrueMatte, TrueMetal
from fit_material.renderer.materials.mtl_reader import read_mtl
from fit_material.renderer.scene.lights import DirectionalLightSpec
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

FIDELITY = replace(PRESETS["standard"], pixels=2000, footprint=2)
GOLD = TrueMetal((0.146, 0.425, 1.431), (3.578, 2.326, 1.85), 0.2)
PLASTIC = TrueGlossy((0.6, 0.2, 0.1), (0.04, 0.04, 0.04), 0.15)
CLAY = TrueMatte((0.5, 0.3, 0.2))
LAMP = DirectionalLightSpec(type="directional", direction=(0.4, 0.8, 0.6), irradiance=(4.0, 3.0, 2.0))


def photographs(folder: Path, material, **options) -> Path:
    return synthesise(SynthOptions(material, **{"size": 48, "spp": 256} | options), folder)


def truths(scene: Path) -> list[dict]:
    return json.loads((scene.parent / "truth.json").read_text())["materials"]


def assert_recovered(found: FittedMaterial, truth: dict, f0=0.005, color=0.01, alpha=0.05) -> None:
    """The figures that are promised of clean photographs, four errors wider: these have 256 paths a pixel."""
    assert found.type == truth["type"]
    limits = {"f0": f0, "color": color, "reflectance": 0.05 if found.type == "matte" else f0}
    for key, limit in limits.items():
        if truth[key] is not None and getattr(found, key) is not None:
            errors = np.array(getattr(found.stderr, key), dtype=float)
            np.testing.assert_array_less(np.abs(np.subtract(getattr(found, key), truth[key])), limit + 4 * errors)
    if truth["alpha"]:
        assert abs(found.alpha - truth["alpha"]) < alpha * truth["alpha"] + 4 * found.stderr.alpha


@pytest.mark.slow  # test_example has a glossy one, test_batch matte ones
@pytest.mark.parametrize("material", [PLASTIC, CLAY], ids=["glossy", "matte"])
def test_a_type_and_its_numbers_are_found(tmp_path, material: TrueMaterial):
    scene = photographs(tmp_path / "photographs", material)
    result = fit_scene(scene, tmp_path / "out", FitOptions(FIDELITY))
    (found,), (truth,) = result.materials, truths(scene)
    assert result.status == "converged"
    assert_recovered(found, truth)
    assert f"{truth['type'].capitalize()} is the type that explains the photographs best" in result.message
    assert not found.nearest
    written = read_mtl(tmp_path / "out" / "sphere.thesis.mtl").appearances["default"].material
    assert written.type == truth["type"]
    np.testing.assert_allclose(written.color.tolist(), found.color, rtol=1e-6)  # as float32


def ball_of_three(folder: Path) -> Path:
    """A ball with a metal cap, a glossy belt and a matte bottom."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    height = ball.triangles_center[:, 1]
    lines = [f"v {x} {y} {z}" for x, y, z in ball.vertices] + [f"vn {x} {y} {z}" for x, y, z in ball.vertices]
    for name, chosen in (("cap", height > 0.3), ("belt", np.abs(height) <= 0.3), ("bottom", height < -0.3)):
        lines += [
            f"usemtl {name}",
            *("f " + " ".join(f"{i + 1}//{i + 1}" for i in face) for face in ball.faces[chosen]),
        ]
    path = folder / "ball.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def three(tmp_path_factory) -> tuple[Path, Result]:
    folder = tmp_path_factory.mktemp("three")
    materials = {"cap": GOLD, "belt": PLASTIC, "bottom": CLAY}
    scene = photographs(folder / "photographs", materials, mesh=ball_of_three(folder), size=64)
    return scene, fit_scene(scene, folder / "out", FitOptions(replace(FIDELITY, pixels=1500)))


@pytest.mark.slow
def test_each_of_three_materials_is_found_from_its_own_pixels(three):
    scene, result = three
    assert {material.name for material in result.materials} == {"cap", "belt", "bottom"}
    told = {truth["name"]: truth for truth in truths(scene)}
    for material in result.materials:
        # the grid of 0.07 leaves a few pixels whose neighbour across a border shines in: both are one smooth ball
        assert_recovered(material, told[material.name], f0=0.01, color=0.02, alpha=0.1)


@pytest.mark.slow
def test_one_file_names_the_three(three):
    scene, result = three
    written = read_mtl(scene.parent.parent / "out" / "ball.thesis.mtl").appearances
    assert {name: each.material.type for name, each in written.items()} == {
        "cap": "metal",
        "belt": "glossy",
        "bottom": "matte",
    }
    assert all(f"{name}: " in result.message for name in written)


def test_the_scene_files_word_on_the_type_is_kept(tmp_path):
    scene = photographs(tmp_path / "photographs", GOLD, size=32, spp=64)
    scene.write_text(scene.read_text() + '\n[[materials]]\nname = "default"\ntype = "matte"\n')
    (found,) = fit_scene(scene, tmp_path / "out", FitOptions(PRESETS["preview"])).materials
    assert found.type == "matte"


@pytest.mark.parametrize(
    "material",
    [pytest.param(GOLD, marks=pytest.mark.slow), pytest.param(PLASTIC, marks=pytest.mark.slow), CLAY],
    ids=["metal", "glossy", "matte"],
)
def test_a_directional_light_is_part_of_the_picture(tmp_path, material):
    """Without it the ball would seem twice as bright, or the wrong one of its numbers would move."""
    scene = photographs(tmp_path / "photographs", material, lights=(LAMP,))
    result = fit_scene(scene, tmp_path / "out", FitOptions(FIDELITY, type=truths(scene)[0]["type"]))
    assert_recovered(result.materials[0], truths(scene)[0], f0=0.01)
    on = {effect.name for effect in result.effects if effect.on}
    assert ("light-reflection" in on) == (material is not CLAY)


@pytest.mark.parametrize(
    "material",
    [
        pytest.param(TrueMetal(GOLD.n, GOLD.k, None, roughness=0.25), marks=pytest.mark.slow),
        TrueGlossy((0.6, 0.2, 0.1), (0.04, 0.1, 0.3), None, roughness=0.25),
        TrueMatte((0.5, 0.3, 0.2), (0.3, 0.6, 0.9)),
    ],
    ids=["metal", "glossy", "matte"],
)
def test_the_loop_closes_in_the_viewers_model(tmp_path, material: TrueMaterial):
    """Photographs in float32 by the model that is fitted: what comes back differs by rounding and interpolation."""
    scene = photographs(tmp_path / "photographs", material, model="viewer")
    result = fit_scene(scene, tmp_path / "out", FitOptions(PRESETS["viewer"], type=truths(scene)[0]["type"]))
    (found,), (truth,) = result.materials, truths(scene)
    assert found.type == truth["type"]
    for key in ("f0", "color", "reflectance"):
        if truth[key] is not None and getattr(found, key) is not None:
            np.testing.assert_allclose(getattr(found, key), truth[key], atol=1e-4)
    if truth["roughness"] is not None:
        assert found.roughness == pytest.approx(truth["roughness"], abs=1e-3)
    assert result.quality.overall.rms_relative < 1e-3
