"""The fit itself, on pictures made by its own model: what went in has to come out."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from fitter.fidelity import PRESETS, preset
from fitter.nearest import nearest_metals
from fitter.search import fit_metal, radiance_of
from fitter.selection import Observations
from fitter.solve import SOLVERS
from fitter.uncertainty import spread
from fitter.viewer_roughness import viewer_roughness
from renderer import gbuffer
from renderer.environment import Environment
from renderer.mesh import Sphere
from renderer.studio import studio
from renderer.views import views
from shaders.materials import Metal


@pytest.fixture(scope="module")
def light() -> Environment:
    return studio(128)


def surface_of(side: int, footprint: int = 1) -> gbuffer.GBuffer:
    """Every pixel of three views of the sphere that it covers wholly."""
    trace, parts = gbuffer.tracer(Sphere()), []
    for view in views(3, Sphere()):
        camera = view.camera(side)
        row, column = gbuffer.pixel_centres(trace, camera).front.nonzero().T
        surface = gbuffer.pixel_footprints(trace, camera, column, row, footprint)
        parts.append(surface[surface.front.all(1)])
    return gbuffer.concatenate(parts)


def gold(roughness: float) -> Metal:
    n, k = ((0.146, 0.425, 1.431), (3.578, 2.326, 1.85))
    return Metal(*(torch.tensor(v, dtype=torch.float64) for v in (n, k, roughness)))


def quiet(stage: str, share: float) -> None:
    pass


@pytest.mark.parametrize("rho", [0.1, 0.4])
def test_the_viewers_model_finds_its_own_metal(light, rho):
    """No noise and no integration error: what is left is the interpolation between 24 levels of ρ (below 1e-3 of ρ)
    and the solver's tolerance of 1e-6."""
    surface = surface_of(32)
    fidelity = PRESETS["viewer"]
    seen = radiance_of(gold(rho), surface, light, fidelity, samples=49, seed=0)
    fit = fit_metal(Observations(surface, seen, 0.0), light, fidelity, SOLVERS["lm"], seed=0, progress=quiet)
    assert fit.solution.status == "converged"
    torch.testing.assert_close(fit.metal.f0, gold(rho).f0, atol=1e-3, rtol=0)
    assert float(fit.metal.roughness) == pytest.approx(rho, abs=2e-3)


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize("alpha", [0.05, 0.3, 0.9])
def test_microfacets_are_found_within_the_stated_errors(light, distribution, alpha):
    """Pictures of 4096 samples, fitted with 256 and another seed. Five standard errors: the chance of a sound fit to
    fail in one of seven numbers is 4e-6."""
    surface = surface_of(24, footprint=2)
    fidelity = replace(preset("preview", distribution), samples=256, search_samples=64)
    seen = radiance_of(gold(alpha), surface, light, fidelity, samples=4096, seed=5)
    fit = fit_metal(Observations(surface, seen, 0.0), light, fidelity, SOLVERS["lm"], seed=0, progress=quiet)
    truth, errors = gold(alpha), spread(fit.residuals, fit.halves, fit.x).covariance.diagonal().sqrt()
    assert fit.solution.status == "converged"
    assert (torch.logit(fit.metal.f0) - torch.logit(truth.f0)).abs().lt(5 * errors[:3]).all()
    roughness = fit.residuals.coordinates.roughness
    assert abs(fit.x[-1] - roughness.free(truth.roughness)) < 5 * errors[-1]
    assert errors[-1] < 0.2  # of logit in the span's logarithm, 0.09 of alpha at most: the bound above means something


def test_the_nearest_metal_is_the_one_that_was_photographed(light):
    surface = surface_of(24, footprint=2)
    fidelity = preset("preview")
    seen = radiance_of(gold(0.2), surface, light, fidelity, samples=1024, seed=5)
    fit = fit_metal(Observations(surface, seen, 0.0), light, fidelity, SOLVERS["lm"], seed=0, progress=quiet)
    nearest = nearest_metals(fit.x, fit.residuals.coordinates, spread(fit.residuals, fit.halves, fit.x))
    assert nearest[0].name == "gold"
    assert [each.distance for each in nearest] == sorted(each.distance for each in nearest)


def test_the_viewers_roughness_of_its_own_picture_is_found(light):
    """The picture is the 49 taps' own: the least difference is none, and Brent's method ends within 1e-4."""
    surface = surface_of(32)
    seen = radiance_of(gold(0.35), surface, light, PRESETS["viewer"], samples=49, seed=0)
    found = viewer_roughness(Observations(surface, seen, 0.0), light, gold(0.1))
    assert found.rho == pytest.approx(0.35, abs=2e-3)  # the picture's table interpolates between levels of ρ
    assert 0 < found.stderr < 0.01
