"""What is reported of a matte fit whose reflectance came out above 1: the fit whose reflectance is 1."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.optimize import lsq_linear
from scipy.stats import truncnorm

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.fitted.part import FittedPart
from fit_material.fitter.forward.lighting import lighting_for
from fit_material.fitter.least_squares.covariance import TWO_SIDED_95
from fit_material.fitter.least_squares.jacobian import jacobian
from fit_material.fitter.least_squares.residuals import Residuals
from fit_material.fitter.least_squares.solvers import Solution
from fit_material.fitter.materials.coordinates import Coordinates
from fit_material.fitter.materials.matte import MatteCoordinates
from fit_material.fitter.observations.scene_data import load
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_materials import fit_parts
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.uncertainty.active_bound import _below_lambert, _lambertian
from fit_material.renderer.materials.mtl_reader import read_mtl
from fit_material.shaders.materials.types import Matte
from tests.support.modelled import Modelled, written
from tests.support.soft_scene import soft_light

WHITE = torch.ones(3, dtype=torch.float64)
COLOR = torch.tensor([0.6, 0.3, 0.05], dtype=torch.float64)
CASES = [("viewer", 1.0, 1), ("viewer", 1.0, 3), ("viewer", 1.05, 0), ("preview", 1.05, 0)]
"""Fidelity, reflectance, seed: those of two channels come out above 1, of other two, of all, the shared one."""


def clay_scene(folder: Path, reflectance: float, seed: int) -> Path:
    """A ball by our own model, which can darken towards grazing angles more than a Lambertian; 2 % of noise."""
    clay = {"ball": Matte(COLOR, reflectance * WHITE)}
    return written(Modelled(clay, soft_light(), azimuths=(0, 120, 240), size=24, noise=0.02, seed=seed), folder)


def options(fidelity: str) -> FitOptions:
    return FitOptions(replace(PRESETS[fidelity], pixels=600), type="matte", check=False)


def part_of(scene: Path, fidelity: str) -> FittedPart:
    how, loaded = options(fidelity), load(scene)
    lighting = lighting_for(loaded, how, torch.device("cpu"))
    (part,) = fit_parts(loaded, loaded.tracer(), lighting, how, lambda stage, share: None, scene)
    return part


def of_lambertian(residuals: Residuals) -> tuple[list[float], list[float]]:
    """Colour and standard errors by linear least squares: a Lambertian's picture is its colour times a white one's."""
    white = residuals.model.radiance(Matte(WHITE, WHITE))
    rows = (residuals.whitening * white[:, None]).flatten(0, 1)
    seen = torch.einsum("prc,pc->pr", residuals.whitening, residuals.photograph).flatten()
    color = torch.linalg.lstsq(rows, seen[:, None]).solution[:, 0]
    scatter = (rows @ color - seen).square().sum() / (len(rows) - 3)
    return color.tolist(), (scatter * torch.linalg.inv(rows.T @ rows).diagonal()).sqrt().tolist()


def passed(part: FittedPart) -> list[bool]:
    """Which channels' reflectance came out above 1 where it was free."""
    free = part.choice.fit.solution.x
    return (part.choice.fit.residuals.coordinates.material(free).reflectance > 1).tolist()


@pytest.mark.parametrize(("fidelity", "reflectance", "seed"), CASES)
def test_a_colour_beyond_the_lambertian_is_the_lambertians(tmp_path, fidelity, reflectance, seed):
    """Value and interval; a channel whose reflectance stays below 1 keeps its own, which are wider.

    The solver ends within a thousandth of an error. The sandwich's standard errors are known to some percent: of 600
    pixels √(2/600), and the residuals of a reflectance of 1.05 hold what a Lambertian cannot explain. What reflectances
    below 1 would add to them is tested below.
    """
    part = part_of(clay_scene(tmp_path, reflectance, seed), fidelity)
    color, errors = of_lambertian(part.choice.fit.residuals)
    material, beyond = part.material, passed(part)
    assert sum(beyond) == (2 if reflectance == 1 else 3)
    for channel, (expected, error) in enumerate(zip(color, errors, strict=True)):
        value, (low, high) = material.color[channel], material.interval95.color[channel]
        if beyond[channel]:
            assert value == pytest.approx(expected, abs=1e-3 * error)
            assert material.stderr.color[channel] > 0.8 * error
            half = TWO_SIDED_95 * material.stderr.color[channel]
            assert (value - low, high - value) == pytest.approx((half, half), rel=0.05)  # a logit bends a little
            assert material.reflectance[channel] == 1
        else:
            assert material.stderr.color[channel] > 5 * error
            assert material.reflectance[channel] < 1


@pytest.mark.parametrize(("fidelity", "reflectance", "seed"), CASES)
def test_the_picture_is_of_the_material_reported(tmp_path, fidelity, reflectance, seed):
    part = part_of(clay_scene(tmp_path, reflectance, seed), fidelity)
    numbers = (torch.tensor(each, dtype=torch.float64) for each in (part.material.color, part.material.reflectance))
    fit = part.choice.fit
    torch.testing.assert_close(fit.picture, fit.residuals.model.radiance(Matte(*numbers)), rtol=1e-12, atol=0)


def test_result_and_mtl_have_the_same_numbers(tmp_path):
    scene = clay_scene(tmp_path, 1.0, seed=3)
    part = part_of(scene, "viewer")
    (found,) = fit_scene(scene, tmp_path / "out", options("viewer")).materials
    assert found.color == pytest.approx(part.material.color, rel=1e-9)
    (file,) = (tmp_path / "out").glob("*.thesis.mtl")
    (told,) = (each.material for each in read_mtl(file).appearances.values())
    np.testing.assert_allclose(told.color.tolist(), found.color, rtol=1e-6)  # as float32
    np.testing.assert_allclose(told.reflectance.tolist(), found.reflectance, rtol=1e-6)


@dataclass(frozen=True)
class Bowl:
    """Residuals that are linear in a whole free vector: L (x - x̂), of covariance C = (LᵀL)⁻¹."""

    coordinates: Coordinates
    root: torch.Tensor
    best: torch.Tensor

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        whole = x if isinstance(self.coordinates, MatteCoordinates) else self.coordinates.completed(x)
        return self.root @ (whole - self.best)


@pytest.mark.parametrize("seed", range(8))
def test_reflectances_are_held_with_all_else_at_the_conditional_mean(seed):
    """And those that come to pass 1 on account of it, too: the least squares whose reflectances are 1 at most.

    With an unknown beside the material. In most of these bowls holding one moves another beyond.
    """
    generator, coordinates = torch.Generator().manual_seed(seed), MatteCoordinates()
    root = torch.eye(7).double() + torch.randn(7, 7, generator=generator, dtype=torch.float64)
    best = torch.cat([torch.zeros(3), torch.tensor([1.2, 0.68, 0.5]), torch.ones(1)]).double()
    solution = Solution(best, 0.0, "converged", 1, 0.0)
    fit: Any = Fit(Bowl(coordinates, root, best), solution, best, 0.0)  # type: ignore[arg-type]
    held = _lambertian(fit, coordinates, coordinates.beyond_lambert(best))
    holding: Any = held.residuals.coordinates
    x = holding.completed(held.x)
    which = (~holding.kept(7)).nonzero()[:, 0]
    covariance = torch.linalg.inv(root.T @ root)
    follows = covariance[:, which] @ torch.linalg.inv(covariance[which][:, which])
    torch.testing.assert_close(x, best + follows @ (coordinates.lambert - best[which]), rtol=0, atol=1e-6)
    most = [np.inf] * 3 + [coordinates.lambert] * 3 + [np.inf]
    bounded = lsq_linear(root.numpy(), (root @ best).numpy(), (-np.inf, most), tol=1e-14)
    np.testing.assert_allclose(x.numpy(), bounded.x, atol=1e-4)
    assert jacobian(holding.completed, held.x).sum() == len(held.x)  # each of its numbers is one of the whole


@pytest.mark.parametrize("z", [0.01, 0.5, 2.0, 20.0])
def test_what_is_held_may_be_less(z):
    """Second moments about a number held at 0 and others at their conditional means, of 10⁶ draws of a normal
    distribution: that number from where it is below 0, by its cumulative distribution, the others given it. Squares of
    normal numbers scatter by √2 of their mean, 1.4e-3 in all; five of these."""
    generator = torch.Generator().manual_seed(3)
    root = torch.randn(4, 4, generator=generator, dtype=torch.float64)
    free, count = torch.linalg.inv(root.T @ root), 1_000_000
    sigma = free[3, 3].sqrt()
    follows = free[:3, 3] / free[3, 3]
    own = free[:3, :3] - torch.outer(follows, follows) * free[3, 3]
    below = truncnorm(-np.inf, -z, loc=z).ppf((np.arange(count) + 0.5) / count)
    held = sigma * torch.from_numpy(below)
    others = torch.linalg.cholesky(own) @ torch.randn(3, count, generator=generator, dtype=torch.float64)
    drawn = torch.cat([others + follows[:, None] * held, held[None]])
    kept = torch.tensor([True, True, True, False])
    found = _below_lambert(free, torch.cat([torch.zeros(3).double(), (z * sigma)[None]]), kept, own)
    scale = found.diagonal().sqrt()
    expected = drawn @ drawn.T / count
    torch.testing.assert_close(found / scale / scale[:, None], expected / scale / scale[:, None], rtol=0, atol=7e-3)
