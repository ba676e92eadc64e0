"""The fit itself, on pictures made by its own model: what went in has to come out."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import torch

from fit_material.fitter.estimation import coarse_to_fine
from fit_material.fitter.estimation.coarse_to_fine import Problem, fit_material, refit_nearby
from fit_material.fitter.estimation.model_selection import DECISIVE, fit_type
from fit_material.fitter.estimation.roughness_survey import surveyed
from fit_material.fitter.estimation.viewer_roughness import viewer_roughness
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.least_squares.covariance import sandwich_covariance
from fit_material.fitter.least_squares.reduced_residuals import solved
from fit_material.fitter.least_squares.solvers import SOLVERS
from fit_material.fitter.materials.metal import TINTS
from fit_material.fitter.metal_prior.nearest_metals import nearest_metals
from fit_material.fitter.observations.pixel_selection import Observations
from fit_material.fitter.options.fidelity import PRESETS, Fidelity, preset
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.viewer_model.viewer_light import surroundings
from fit_material.shaders.materials.types import Glossy, Material, Matte, Metal
from fit_material.shaders.materials.widths import Blur, Microfacet, Width


@pytest.fixture(scope="module")
def light() -> Environment:
    return studio(128)


def surface_of(side: int, footprint: int = 1) -> GBuffer:
    """Every pixel of three views of the sphere that it covers wholly."""
    trace, parts = gbuffer.tracer(Sphere()), []
    for view in views(3, Sphere()):
        camera = view.camera(side)
        row, column = gbuffer.pixel_centres(trace, camera).front.nonzero().T
        surface = gbuffer.pixel_footprints(trace, camera, column, row, footprint)
        parts.append(surface[surface.front.all(1)])
    return gbuffer.concatenate(parts)


def float64(values) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def gold(roughness: float, lobe: type[Width] = Microfacet) -> Metal:
    return Metal(float64((0.146, 0.425, 1.431)), float64((3.578, 2.326, 1.85)), lobe(float64(roughness)))


def quiet(stage: str, share: float) -> None:
    pass


def problem_of(truth: Material, surface: GBuffer, light: Environment, fidelity: Fidelity, **made: Any) -> Problem:
    """The problem of finding a material from a picture that the model itself makes, with other samples; its width is
    taken for that of the model's lobe."""
    if truth.width is not None:
        truth = truth.with_width((Blur if fidelity.blurs else Microfacet)(truth.width.value))
    making = Lighting(light, (), replace(fidelity, **made), seed=5)
    seen = making.radiance(truth, surface, making.fidelity.samples)
    place = torch.zeros(len(seen), 3, dtype=torch.long)
    observed = Observations(surface, seen, self_seeing=0.0, edged=False, available=len(seen), place=place)
    return Problem(observed, Lighting(light, (), fidelity), SOLVERS["lm"], quiet)


@pytest.mark.parametrize("rho", [pytest.param(0.1, marks=pytest.mark.slow), 0.4])
def test_the_viewers_model_finds_its_own_metal(light, rho):
    """No noise and no integration error: what is left is the interpolation between levels of ρ and the solver's
    tolerance of 1e-6."""
    fit = fit_material(problem_of(gold(rho, Blur), surface_of(32), light, PRESETS["viewer"]), "metal")
    assert fit.solution.status == "converged"
    torch.testing.assert_close(fit.material.f0, gold(rho, Blur).f0, atol=1e-4, rtol=0)
    assert float(fit.material.width.value) == pytest.approx(rho, abs=1e-3)


@pytest.mark.parametrize("rho", [pytest.param(0.1, marks=pytest.mark.slow), 0.4])
def test_the_viewers_model_finds_its_own_glossy_material(light, rho):
    """Each channel has a reflectance of its own; as above."""
    truth = Glossy(float64((0.6, 0.2, 0.05)), float64((0.04, 0.1, 0.3)), Blur(float64(rho)))
    fit = fit_material(problem_of(truth, surface_of(32), light, PRESETS["viewer"]), "glossy")
    assert fit.solution.status == "converged"
    for key in ("color", "reflectance"):
        torch.testing.assert_close(getattr(fit.material, key), getattr(truth, key), atol=1e-4, rtol=0)
    assert float(fit.material.width.value) == pytest.approx(rho, abs=1e-3)


@pytest.mark.parametrize("fidelity", ["viewer", "preview"])
@pytest.mark.parametrize("reflectance", [0.3, 1.0])
def test_a_matte_material_is_found(light, fidelity, reflectance):
    """A reflectance of 1 is the end of its interval, which the fit comes near to in steps of a logistic tail."""
    truth = Matte(float64((0.8, 0.3, 0.02)), float64([reflectance] * 3))
    fit = fit_material(problem_of(truth, surface_of(24, 1), light, PRESETS[fidelity]), "matte")
    assert fit.solution.status == "converged"
    torch.testing.assert_close(fit.material.color, truth.color, atol=1e-4, rtol=0)
    torch.testing.assert_close(fit.material.reflectance, truth.reflectance, atol=1e-4, rtol=0)


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize("alpha", [0.05, pytest.param(0.3, marks=pytest.mark.slow), 0.9])
def test_microfacets_are_found_within_the_stated_errors(light, distribution, alpha):
    """Pictures of 4096 samples, fitted with 256 and another seed. Five standard errors: the chance of a sound fit to
    fail in one of seven numbers is 4e-6."""
    fidelity = replace(preset("preview", distribution), samples=256, search_samples=64)
    fit = fit_material(problem_of(gold(alpha), surface_of(24, 2), light, fidelity, samples=4096), "metal")
    truth, errors = gold(alpha), sandwich_covariance(fit.residuals, fit.x).covariance.diagonal().sqrt()
    assert fit.solution.status == "converged"
    assert (torch.logit(fit.material.f0) - torch.logit(truth.f0)).abs().lt(5 * errors[:3]).all()
    roughness = fit.residuals.coordinates.width
    assert abs(fit.x[-1] - roughness.free(truth.width.value)) < 5 * errors[-1]
    share = errors[-1] / 4 * 2 * math.log(fidelity.spans[-1])  # a logit's slope is a quarter at most
    assert share < 0.03  # of alpha, or the bound above would mean nothing


@pytest.mark.parametrize("alpha", [pytest.param(0.05, marks=pytest.mark.slow), 0.4])
def test_a_rough_plastic_is_found_within_the_stated_errors(light, alpha):
    """As above, with colour and one reflectance."""
    truth = Glossy(float64((0.6, 0.2, 0.05)), float64((0.05, 0.05, 0.05)), Microfacet(float64(alpha)))
    fit = fit_material(problem_of(truth, surface_of(24, 2), light, preset("preview"), samples=4096), "glossy")
    errors = sandwich_covariance(fit.residuals, fit.x).covariance.diagonal().sqrt()
    assert fit.solution.status == "converged"
    assert (fit.x - fit.residuals.coordinates.free(truth)).abs().lt(5 * errors).all()
    torch.testing.assert_close(fit.material.color, truth.color, atol=0.03, rtol=0)  # or the errors would mean nothing


TRUTHS = {
    "metal": gold(0.3),
    "glossy": Glossy(float64((0.5, 0.3, 0.1)), float64((0.04, 0.04, 0.04)), Microfacet(float64(0.2))),
    "matte": Matte(float64((0.5, 0.3, 0.1)), float64((1.0, 1.0, 1.0))),
}


@pytest.mark.parametrize("fidelity", [pytest.param("viewer", marks=pytest.mark.slow), "preview"])
@pytest.mark.parametrize("kind", TRUTHS)
def test_the_type_is_found(light, fidelity, kind):
    surface = surface_of(24, PRESETS[fidelity].footprint)
    choice = fit_type(problem_of(TRUTHS[kind], surface, light, PRESETS[fidelity]), None)
    assert choice.fit.material.type == kind
    assert choice.runner_up[1] > DECISIVE


@pytest.mark.slow
def test_the_noise_of_few_samples_is_no_misfit():
    """Rough iron under small lamps: a table of 64 samples errs by more than a body, which has no such noise, would
    misrepresent. By the sum of squares alone it was taken for glossy."""
    radiance = torch.full((64, 128, 3), 0.05)
    radiance[[20, 26, 33], [10, 60, 101]] = torch.tensor([400.0, 900.0, 600.0])[:, None]
    lamps = Environment(radiance)
    iron = Metal(float64((2.87, 2.95, 2.65)), float64((3.05, 2.93, 2.77)), Microfacet(float64(0.4)))
    fidelity = replace(preset("preview"), samples=64, search_samples=64)
    choice = fit_type(problem_of(iron, surface_of(24, 2), lamps, fidelity, samples=8192), None)
    assert choice.fit.material.type == "metal"
    assert choice.runner_up[1] > DECISIVE


def test_only_the_last_round_looks_for_the_metal_everywhere(light, monkeypatch):
    """What a round before it finds says where to look next, and is found anew there."""
    starts = []

    def counted(residuals, started, solver):
        starts.append(len(started))
        return solved(residuals, started, solver)

    monkeypatch.setattr(coarse_to_fine, "solved", counted)
    fidelity = replace(preset("preview"), spans=(1.5, 1.3, 1.1))
    fit_material(problem_of(gold(0.2), surface_of(24, 2), light, fidelity), "metal")
    assert starts[:2] == [1, 1]
    assert starts[2:] == [1 + len(TINTS)]


def test_a_type_that_is_given_is_kept_to(light):
    choice = fit_type(problem_of(TRUTHS["matte"], surface_of(24, 2), light, PRESETS["preview"]), "metal")
    assert choice.fit.material.type == "metal"
    assert choice.runner_up is None


def test_the_nearest_metal_is_the_one_that_was_photographed(light):
    fit = fit_material(problem_of(gold(0.2), surface_of(24, 2), light, preset("preview"), samples=1024), "metal")
    nearest = nearest_metals(fit.x, fit.residuals.coordinates, sandwich_covariance(fit.residuals, fit.x))
    assert nearest[0].name == "gold"
    assert [each.distance for each in nearest] == sorted(each.distance for each in nearest)


@pytest.mark.slow  # three fits
@pytest.mark.parametrize("wrong", [0.1, 0.8])
def test_a_roughness_that_leaves_the_last_table_is_sought_among_all(light, wrong):
    """From there, tables that reach a tenth further each time end before the true 0.3."""
    elsewhere, there = (problem_of(gold(alpha), surface_of(24, 2), light, preset("preview")) for alpha in (wrong, 0.3))
    near = refit_nearby(there, fit_material(elsewhere, "metal"))
    assert abs(math.log(float(near.material.width.value) / 0.3)) > 0.1
    fit = surveyed(there, near)
    assert fit.solution.status == "converged"
    assert float(fit.material.width.value) == pytest.approx(0.3, rel=0.02)  # its error is 1 % at most, as above


def test_no_radius_of_the_viewer_is_determined_in_light_that_is_everywhere_the_same():
    light = Environment(torch.ones(8, 16, 3))
    observed = problem_of(gold(0.02), surface_of(24, 2), light, preset("preview")).observed
    found = viewer_roughness(observed, surroundings(light), gold(0.02))
    assert found.stderr == math.inf


@pytest.mark.parametrize("kind", ["metal", "glossy"])
def test_the_viewers_roughness_of_its_own_picture_is_found(light, kind):
    """The picture is the 49 taps' own: the least difference is none, and Brent's method ends within 1e-4."""
    truth = TRUTHS[kind].with_width(Blur(float64(0.35)))
    observed = problem_of(truth, surface_of(32), light, PRESETS["viewer"]).observed
    found = viewer_roughness(observed, surroundings(light), truth.with_width(Microfacet(float64(0.1))))
    assert found.rho == pytest.approx(0.35, abs=2e-3)  # the picture's table interpolates between levels of ρ
    assert 0 < found.stderr < 0.01
