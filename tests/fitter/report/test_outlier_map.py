"""What the fit does not explain: a patch that no light of the map makes is found, and noise is not."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from fit_material.fitter.estimation.coarse_to_fine import fit_material
from fit_material.fitter.least_squares.residuals import ROBUST_AT
from fit_material.fitter.options.fidelity import preset
from fit_material.fitter.report.outlier_map import standardised_residuals
from fit_material.renderer.synthesis.studio import studio
from tests.fitter.estimation.test_coarse_to_fine import TRUTHS, problem_of, surface_of


@pytest.fixture(scope="module")
def spotted():
    """A glossy ball with noise of 1 %, on which somebody's reflection, a twentieth of its pixels, adds half as much."""
    fidelity = replace(preset("preview"), samples=256, search_samples=64)
    problem = problem_of(TRUTHS["glossy"], surface_of(32, 2), studio(128), fidelity, samples=1024)
    seen, surface = problem.observed.radiance, problem.observed.surface
    normal = surface.normal[:, 0]
    nearest = (normal @ normal[len(normal) // 6]).argsort(descending=True)[: len(normal) // 20]
    spot = torch.zeros(len(seen), dtype=torch.bool).index_fill(0, nearest, True)
    noise = torch.randn(seen.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    seen = seen * (1 + 0.01 * noise) * torch.where(spot, 1.5, 1.0)[:, None]
    fit = fit_material(replace(problem, observed=replace(problem.observed, radiance=seen)), "glossy")
    return fit, spot


def test_the_spot_stands_out_and_counts_for_little(spotted):
    """50 % of light under 1 % of noise; at its rim neighbours outside tell the noise, inside all are as wrong."""
    deviation, weight = standardised_residuals(spotted[0])
    spot = spotted[1]
    assert (deviation[spot] < -ROBUST_AT).double().mean() > 0.95  # the fit is darker
    assert weight[spot].median() < 0.05


def test_the_rest_is_noise(spotted):
    """Beyond six standard deviations lies next to nothing of it, and pixels count as they usually do: half of them
    have less than the median noise, and those beside the spot, whose neighbours are in it, more."""
    deviation, weight = standardised_residuals(spotted[0])
    rest = ~spotted[1]
    assert (deviation[rest].abs() > ROBUST_AT).double().mean() < 0.02
    assert weight[rest].median() > 0.8
    assert 0.4 < float(deviation[rest].abs().quantile(0.6827)) < 1.5  # a mean of three channels, one σ of it about
