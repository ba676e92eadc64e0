"""The main job on small synthetic scenes: what was photographed comes back, within the errors that are stated."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.fitter.result.schema import FittedMaterial, Result, read_result
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

# The directions that the standard has, for half its pixels and with fewer rays in each: F0 to half a percent.
FIDELITY = replace(PRESETS["standard"], pixels=2000, footprint=2)


def photograph(folder: Path, name: str, alpha: float, distribution="ggx", mesh: Path | None = None, seed=0) -> Path:
    known = metal(name)
    material = TrueMetal(known.n, known.k, alpha, distribution=distribution)
    return synthesise(SynthOptions(material, mesh=mesh, size=48, spp=256, seed=seed), folder)


def fitted(scene: Path, out: Path, solver="lm", lobe="ggx", seed=0) -> Result:
    return fit_scene(scene, out, FitOptions(replace(FIDELITY, lobe=lobe), solver, seed, type="metal"))


def truth_of(scene: Path) -> dict:
    return json.loads((scene.parent / "truth.json").read_text())["materials"][0]


def icosphere(folder: Path) -> Path:
    """A ball of 1280 facets with the normals of the true one: between its corners nothing is exact."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    path = folder / "icosphere.obj"
    path.write_text(trimesh.exchange.obj.export_obj(ball, include_normals=True))
    return path


def assert_recovered(found: FittedMaterial, truth: dict, extra: float = 0.0) -> None:
    """Each number within four of its standard errors, and a margin for what these do not know.

    The integration's part of an error is estimated from one difference of two halves, which falls short of its own
    standard deviation by a factor of four in every fifth run; and the light at a pixel is a mean of 2 × 2 rays where
    the photograph's is over its area. Both were below 0.003 in F0 and 1 % in alpha over the scenes tried here.

    Args:
        extra: further margin, for what a scene's geometry leaves uncertain.
    """
    f0, sigma = np.array(found.f0), np.array(found.stderr.f0, dtype=float)
    np.testing.assert_array_less(np.abs(f0 - truth["f0"]), 4 * sigma + 0.005 + extra)
    assert abs(found.alpha / truth["alpha"] - 1) < 4 * found.stderr.alpha / truth["alpha"] + 0.01 + extra
    for key in ("n", "k"):
        value, error = np.array(getattr(found, key)), np.array(getattr(found.stderr, key), dtype=float)
        known = np.array(getattr(found.determined, key))
        off = np.abs(value - truth[key])[known]
        np.testing.assert_array_less(off, (4 * error + (0.05 + 10 * extra) * np.array(truth[key]))[known])


@pytest.fixture(scope="module")
def gold(tmp_path_factory) -> Path:
    return photograph(tmp_path_factory.mktemp("gold"), "Au", 0.2)


@pytest.fixture(scope="module")
def iron(tmp_path_factory) -> Path:
    return photograph(tmp_path_factory.mktemp("iron"), "Fe", 0.3, seed=1)


@pytest.fixture(scope="module")
def iron_result(iron) -> Result:
    return fitted(iron, iron.parent / "lm")


def test_gold_comes_back(gold, tmp_path):
    result = fitted(gold, tmp_path)
    (found,) = result.materials
    assert result.status == "converged"
    assert_recovered(found, truth_of(gold))
    assert found.nearest[0].name == "gold"
    assert all(found.determined.f0)
    assert found.determined.alpha
    assert result.quality.overall.rms_relative < 0.15  # the silhouette's, and noise of 256 paths and of 192 directions
    assert [effect.name for effect in result.effects if effect.on][:2] == ["reflection", "blur"]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "alpha", "distribution", "seed"), [("Cu", 0.1, "beckmann", 2), ("Al", 0.4, "ggx", 3)])
def test_other_metals_come_back(tmp_path, name, alpha, distribution, seed):
    scene = photograph(tmp_path, name, alpha, distribution, seed=seed)
    (found,) = fitted(scene, tmp_path / "out", lobe=distribution, seed=seed).materials
    assert_recovered(found, truth_of(scene))


def test_a_mesh_comes_back(tmp_path):
    """Facets of an icosphere, 1280 of them, stand 0.4 % inside the ball and bend its reflections by as much."""
    scene = photograph(tmp_path / "photographs", "Cu", 0.25, mesh=icosphere(tmp_path))
    result = fitted(scene, tmp_path / "out")
    assert_recovered(result.materials[0], truth_of(scene), extra=0.004)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"result.json", "report.html", "comparison.png", "icosphere.mtl", "icosphere.thesis.mtl"}


def test_iron_comes_back(iron, iron_result):
    assert iron_result.status == "converged"
    assert_recovered(iron_result.materials[0], truth_of(iron))
    determined = iron_result.materials[0].determined
    assert all([*determined.f0, *determined.k, determined.alpha])


@pytest.mark.parametrize("solver", [pytest.param("adam", marks=pytest.mark.slow), "lbfgs"])
def test_solvers_agree(iron, iron_result, solver, tmp_path):
    """They minimise one sum of squares; where they stop may differ by their tolerance, a share of the error."""
    (found,), (reference,) = fitted(iron, tmp_path, solver=solver).materials, iron_result.materials
    for key in ("f0", "n", "k"):
        off = np.abs(np.subtract(getattr(found, key), getattr(reference, key)))
        np.testing.assert_array_less(off, 0.2 * np.array(getattr(reference.stderr, key)))
    assert abs(found.alpha - reference.alpha) < 0.2 * reference.stderr.alpha


def timeless(result):
    """What a result says, but for the time that the fit took: the report says that, too."""
    said = result.model_dump(exclude={"time"})
    return said | {"outputs": [file for file in said["outputs"] if file["path"] != "report.html"]}


def test_the_same_seed_gives_the_same_result_and_another_does_not(iron, iron_result, tmp_path):
    again, other = fitted(iron, tmp_path / "again"), fitted(iron, tmp_path / "other", seed=1)
    assert timeless(again) == timeless(iron_result)
    assert other.materials[0].f0 != iron_result.materials[0].f0
    assert_recovered(other.materials[0], truth_of(iron))


def test_what_is_returned_is_what_is_written(iron, iron_result):
    assert read_result(iron.parent / "lm" / "result.json") == iron_result


def test_time_adds_up(iron_result):
    parts = iron_result.time.model_dump()
    total = parts.pop("total")
    assert sum(parts.values()) == pytest.approx(total, rel=0.05)  # the last files are written after the last look


def test_progress_is_told_in_order(iron, tmp_path):
    told: list[tuple[str, float]] = []
    options = FitOptions(PRESETS["preview"], type="metal")
    fit_scene(iron, tmp_path, options, lambda stage, share: told.append((stage, share)))
    stages = list(dict.fromkeys(stage for stage, _ in told))
    assert stages == ["reading", "planning", "choosing pixels", "searching", "integrating", "writing the report"]
    assert all(0 <= share <= 1 for _, share in told)


@pytest.mark.slow  # two more fits
def test_a_photograph_that_repeats_another_changes_no_number(iron, tmp_path):
    """Its noise is the same noise; counted again it would make the errors smaller."""
    (tmp_path / "again").mkdir()
    for file in iron.parent.glob("*"):
        if file.is_file():
            (tmp_path / "again" / file.name).write_bytes(file.read_bytes())
    head, *views = iron.read_text().split("[[photographs]]")
    again = tmp_path / "again" / "scene.toml"
    again.write_text("[[photographs]]".join([head, *views, views[0]]))
    options = FitOptions(PRESETS["preview"], type="metal")
    found, once = fit_scene(again, tmp_path / "out", options), fit_scene(iron, tmp_path / "once", options)
    assert found.materials[0] == once.materials[0]
    assert "Photographs that repeat an earlier one were left out: view_0." in found.message


@pytest.mark.slow
def test_a_wrong_exposure_is_not_hidden(iron, tmp_path):
    """Three times brighter than it was: F0 of 1.6, which no metal has."""
    scene = iron.with_name("too_bright.toml")
    scene.write_text(iron.read_text().replace("exposure = 1.0", "exposure = 0.33"))
    result = fit_scene(scene, tmp_path, FitOptions(PRESETS["preview"], type="metal"))
    assert result.quality.overall.rms_relative > 0.3


@pytest.mark.slow
def test_a_wrong_exposure_is_found_where_it_is_fitted(iron, iron_result, tmp_path):
    """Told half of what it was, the one factor of all photographs is 2, which iron's curve tells to some per cent:
    its reflectance at grazing angles is 1 whatever the exposure: of pixels there the rays' angles count. F0 is known
    less well than where nothing is fitted."""
    scene = iron.with_name("unknown.toml")
    scene.write_text('exposure = "fit"\n' + iron.read_text().replace("exposure = 1.0", "exposure = 0.5"))
    fidelity = replace(FIDELITY, footprint=PRESETS["standard"].footprint)
    result = fit_scene(scene, tmp_path / "out", FitOptions(fidelity, type="metal"))
    assert result.nuisances is not None
    (record,) = result.nuisances
    assert (record.name, record.photograph, record.by_surroundings) == ("exposure", None, False)
    assert record.interval95[0] < 2 < record.interval95[1]
    assert result.exposure == pytest.approx([0.5 * record.value] * 3)
    truth = truth_of(scene)["f0"]
    material, plain = result.materials[0], iron_result.materials[0]
    assert material.interval95.f0 is not None
    assert plain.interval95.f0 is not None
    for (low, high), (least, most), true in zip(material.interval95.f0, plain.interval95.f0, truth, strict=True):
        assert low < true < high
        assert high - low > 1.5 * (most - least)
    assert read_result(tmp_path / "out" / "result.json") == result
    assert "Fitted beside the material" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    # the pictures are in the photographs' exposure, and differ by the noise that they differ by anyway
    assert result.quality.overall.rms_relative == pytest.approx(iron_result.quality.overall.rms_relative, rel=0.1)
    assert iron_result.nuisances is None


@pytest.mark.parametrize("device", ["nonsense", "meta", "cuda:99", ""])
def test_devices_that_are_not_there(iron, tmp_path, device):
    with pytest.raises(InputError, match=r"^--device: .*expected one that torch can use here: cpu"):
        fit_scene(iron, tmp_path / "out", FitOptions(FIDELITY, device=device))
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has CUDA")
def test_cuda_where_there_is_none(iron, tmp_path):
    with pytest.raises(InputError, match=r"^--device: is cuda, expected"):
        fit_scene(iron, tmp_path / "out", FitOptions(FIDELITY, device="cuda"))


def test_ctrl_c_while_solving_is_ctrl_c(iron, tmp_path, monkeypatch):
    """Inside JAX's callback an exception becomes a text; the interruption must come out as one all the same."""
    from fit_material.fitter.least_squares.residuals import Residuals

    calls = 0

    def interrupted(self, x):
        nonlocal calls
        calls += 1
        if calls > 3:
            raise KeyboardInterrupt
        return ordinary(self, x)

    ordinary = Residuals.__call__
    monkeypatch.setattr(Residuals, "__call__", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fit_scene(iron, tmp_path, FitOptions(PRESETS["preview"]))
    assert not list(tmp_path.iterdir())
