"""Light that is the same from everywhere shows no small roughness: none may be called determined, on any processor.

What another processor does to a fit is emulated: other instructions, by `ATEN_CPU_CAPABILITY` in a child process and by
torch in the place of the compiled kernel, and other roundings of every light table. Each way the noise is another, and
with it the roughness that comes out; the verdict must not be.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fit_material.fitter.fitted.part import FittedPart
from fit_material.fitter.forward.lighting import lighting_for
from fit_material.fitter.observations.scene_data import load
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_materials import fit_parts
from fit_material.renderer.light_tables import light_table
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.shaders.materials.types import Glossy, Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.support.modelled import Modelled, written
from tests.support.paths import ROOT, SOURCE
from tests.support.soft_scene import soft_light


def float64(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def material(kind: str, alpha: float) -> Metal | Glossy:
    roughness = torch.tensor(alpha, dtype=torch.float64)
    if kind == "metal":
        return Metal(float64(2.87, 2.95, 2.68), float64(3.36, 2.93, 2.82), Microfacet(roughness))
    return Glossy(float64(0.6, 0.3, 0.1), float64(0.05, 0.05, 0.05), Microfacet(roughness))


def scene(folder: Path, kind: str, alpha: float, contrast: float = 0.0, seed: int = 0) -> Path:
    """A ball in grey light; photographs with 1 % of noise."""
    grey = 1 + contrast * np.random.default_rng(5).standard_normal((8, 16, 3))
    ball = {"ball": material(kind, alpha)}
    return written(Modelled(ball, grey.astype(np.float32), size=16, noise=0.01, seed=seed), folder)


def fitted(path: Path, kind: str, fidelity: str = "preview", seed: int = 0) -> FittedPart:
    options = FitOptions(PRESETS[fidelity], type=kind, seed=seed, check=False)
    loaded = load(path)
    lighting = lighting_for(loaded, options, torch.device("cpu"))
    (part,) = fit_parts(loaded, loaded.tracer(), lighting, options, lambda stage, share: None, path)
    return part


def assert_roughness_is_open(part: FittedPart, alpha: float) -> None:
    """It reaches from what no photograph resolves to where the darkening of what is not reflected twice shows."""
    found = part.material
    assert part.choice.fit.solution.status == "converged"
    assert found.determined.alpha is False
    assert found.interval95.alpha is not None
    low, high = found.interval95.alpha
    assert low < 0.0055 < alpha < 0.05 < high
    assert (found.determined.roughness, found.stderr.roughness) == (False, None)
    assert "in this light the picture changes with it by no more than its own error" in part.told


def rounded_otherwise(table: LightTable) -> LightTable:
    generator = torch.Generator().manual_seed(3)
    noise = torch.randn(table.light.shape, generator=generator)
    return replace(table, light=table.light * (1 + 1e-7 * noise))


@pytest.mark.slow  # test_cli has one such fit
@pytest.mark.parametrize("kind", ["metal", "glossy"])
def test_no_roughness_is_determined(tmp_path, kind):
    assert_roughness_is_open(fitted(scene(tmp_path, kind, 0.02), kind), 0.02)


@pytest.mark.slow  # one more such fit
def test_nor_in_light_that_hardly_varies(tmp_path):
    """By a millionth, which is less than the table's noise and the photographs'."""
    assert_roughness_is_open(fitted(scene(tmp_path, "metal", 0.02, contrast=1e-6), "metal"), 0.02)


@pytest.mark.parametrize("contrast", [0.0, pytest.param(1e-6, marks=pytest.mark.slow)])
def test_nor_by_the_viewers_taps_whose_halves_agree(tmp_path, contrast):
    """Without noise, nothing but the rounding of the table is left for a slope."""
    found = fitted(scene(tmp_path, "metal", 0.02, contrast), "metal", "viewer").material
    assert (found.determined.roughness, found.stderr.roughness) == (False, None)
    assert found.interval95.roughness == (0.001, 2.0)
    assert found.determined.f0 == (True, True, True)


@pytest.mark.slow  # one more such fit
def test_what_another_kernel_adds_up_is_no_roughness(tmp_path, monkeypatch):
    monkeypatch.setattr(light_table, "fused_available", lambda: False)
    assert_roughness_is_open(fitted(scene(tmp_path, "metal", 0.02), "metal"), 0.02)


@pytest.mark.slow  # a dozen fits
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("alpha", [0.006, 0.02, 0.03])
@pytest.mark.parametrize("kind", ["metal", "glossy"])
def test_no_small_roughness_is_determined_by_other_seeds_and_roundings(tmp_path, kind, alpha, seed, monkeypatch):
    path, made = scene(tmp_path, kind, alpha, seed=seed), light_table.microfacet_table
    assert_roughness_is_open(fitted(path, kind, seed=seed), alpha)
    monkeypatch.setattr(light_table, "microfacet_table", lambda *a, **b: rounded_otherwise(made(*a, **b)))
    assert_roughness_is_open(fitted(path, kind, seed=seed), alpha)


@pytest.mark.slow  # a fit, a look at all roughnesses, and a fit anew
def test_a_roughness_that_only_a_look_at_all_of_them_shows_is_found(tmp_path):
    """Under soft light the search ends at the least roughness, where its table shows nothing but noise; from there on
    no slope leads to 0.03."""
    gold = Metal(float64(0.2, 0.9, 1.3), float64(3.4, 2.6, 1.9), Microfacet(torch.tensor(0.03, dtype=torch.float64)))
    path = written(Modelled({"ball": gold}, soft_light(), azimuths=(0, 120), size=24), tmp_path)
    part = fitted(path, "metal")
    found = part.material
    assert part.choice.fit.solution.status == "converged"
    for value, error, true in zip(found.f0, found.stderr.f0, gold.f0.tolist(), strict=True):
        assert abs(value - true) < 4 * error < 0.01
    low, high = found.interval95.alpha
    assert low - 0.001 < 0.03 < high + 0.001
    assert high - low < 0.01


@pytest.mark.slow  # the same
def test_nothing_is_sure_of_a_roughness_that_is_not(tmp_path):
    """The light that rough facets hide looks like a darker metal: F0 is not determined where the roughness is not."""
    found = fitted(scene(tmp_path, "metal", 0.5), "metal").material
    true = material("metal", 0.5).f0.tolist()
    for value, known, (low, high) in zip(true, found.determined.f0, found.interval95.f0, strict=True):
        assert not known or low < value < high


CHILD = """
import sys
from pathlib import Path
from tests.fitter.estimation.test_even_light import assert_roughness_is_open, fitted
assert_roughness_is_open(fitted(Path(sys.argv[1]), "metal"), 0.02)
"""


@pytest.mark.slow  # `make test-arithmetic` does the same for the command
def test_other_instructions_find_no_roughness_either(tmp_path):
    environment = {
        **os.environ,
        "ATEN_CPU_CAPABILITY": "default",
        "PYTHONPATH": os.pathsep.join(map(str, (ROOT, SOURCE))),
    }
    path = scene(tmp_path, "metal", 0.02)
    subprocess.run([sys.executable, "-c", CHILD, str(path)], check=True, env=environment)
