"""Correlation of a material's errors, against draws from the free vector's own distribution."""

from __future__ import annotations

import math

import pytest
import torch

from fit_material.fitter.estimation.coarse_to_fine import fit_material
from fit_material.fitter.estimation.viewer_roughness import ViewerRoughness
from fit_material.fitter.fitted.summary import fitted_material
from fit_material.fitter.least_squares.covariance import sandwich_covariance
from fit_material.fitter.options.fidelity import PRESETS, preset
from fit_material.fitter.uncertainty.correlation import correlation
from fit_material.renderer.synthesis.studio import studio
from fit_material.shaders.materials.types import Glossy
from fit_material.shaders.materials.widths import Blur, Microfacet
from tests.fitter.estimation.test_coarse_to_fine import float64, gold, problem_of, surface_of

DRAWS = 20_000


@pytest.mark.parametrize("kind", ["metal", "glossy"])
def test_coefficients_are_those_of_drawn_materials(kind):
    """Free vectors about the one found, a thousandth of its errors wide so that nothing is bent; of `DRAWS` normal
    vectors a coefficient is known to 1/√DRAWS."""
    truth = (
        gold(0.2)
        if kind == "metal"
        else Glossy(float64((0.6, 0.2, 0.05)), float64((0.05,) * 3), Microfacet(float64(0.2)))
    )
    fit = fit_material(problem_of(truth, surface_of(24, 2), studio(128), preset("preview"), samples=1024), kind)
    uncertainty, coordinates = sandwich_covariance(fit.residuals, fit.x), fit.residuals.coordinates
    found = fitted_material("ball", fit, uncertainty, ViewerRoughness(0.3, 0.01), ()).correlation
    root = torch.linalg.cholesky(uncertainty.covariance)
    normal = torch.randn(DRAWS, len(fit.x), generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    drawn = torch.func.vmap(lambda x: _numbers(kind, coordinates.material(x)))(fit.x + 1e-3 * normal @ root.T)
    columns = [_ORDER[kind].index(name) for name in found.numbers]
    expected = torch.corrcoef(drawn.T)[columns][:, columns]
    assert found.numbers[-1] == "alpha"
    assert len(columns) >= 5
    torch.testing.assert_close(float64(found.coefficients), expected, atol=5 / math.sqrt(DRAWS), rtol=0)


def test_numbers_without_errors_have_no_correlation():
    """The viewer's model sees F0 alone, so that n and k have no errors, and these are left out."""
    fit = fit_material(problem_of(gold(0.3, Blur), surface_of(24), studio(64), PRESETS["viewer"]), "metal")
    uncertainty = sandwich_covariance(fit.residuals, fit.x)
    found = fitted_material("ball", fit, uncertainty, None, ()).correlation
    assert {name.split()[0] for name in found.numbers} == {"f0", "roughness"}
    nothing = {key: [] for key in ("n", "k", "f0", "roughness", "alpha")}
    assert correlation(fit, uncertainty, nothing) is None


_ORDER = {
    kind: [f"{key} of {channel}" for key in keys for channel in ("red", "green", "blue")] + ["alpha"]
    for kind, keys in (("metal", ("n", "k", "f0")), ("glossy", ("color", "reflectance")))
}


def _numbers(kind: str, material) -> torch.Tensor:
    triples = (material.n, material.k, material.f0) if kind == "metal" else (material.color, material.reflectance)
    return torch.cat([*triples, material.width.value[None]])
