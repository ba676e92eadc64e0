"""Exposures and white balances as unknowns: priors in closed form, derivatives, and factors that went in come out."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from fit_material.fitter.estimation.coarse_to_fine import Fit, fit_material
from fit_material.fitter.fitted.nuisance_estimates import nuisance_estimates
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.forward.rotated_environment import TURNS, TurnedPixels, joined, turned
from fit_material.fitter.least_squares.covariance import Covariance, sandwich_covariance
from fit_material.fitter.least_squares.noise import even_whitening
from fit_material.fitter.least_squares.nuisances import EXPOSURE_WIDTH, NuisanceFactors, Nuisances, Unknown
from fit_material.fitter.least_squares.reduced_residuals import condensed
from fit_material.fitter.least_squares.residuals import Residuals
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.options.fidelity import PRESETS, preset
from fit_material.fitter.uncertainty.estimates import measured
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.synthesis.studio import studio
from fit_material.shaders.materials.quantities import COLOR, F0
from tests.fitter.estimation.test_coarse_to_fine import TRUTHS, gold, problem_of, surface_of

ALL = (Unknown("exposure"), Unknown("white_balance", channel=0), Unknown("white_balance", channel=2))
EACH = (Unknown("exposure", 0), Unknown("exposure", 1))


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def test_factors_are_products_of_exposure_and_white_balance():
    """By hand: exposure times gain, green being what exposure is of."""
    z = float64([2.0, 1.5, 0.5]).log()
    found = Nuisances.before(ALL, 2).factors(z)
    torch.testing.assert_close(found, float64([[3.0, 2.0, 1.0]] * 2))
    own = Nuisances.before((*EACH, Unknown("white_balance", 1, 0)), 2).factors(float64([2.0, 5.0, 3.0]).log())
    torch.testing.assert_close(own, float64([[2.0, 2.0, 2.0], [15.0, 5.0, 5.0]]))


def test_what_is_seen_behind_the_object_is_weighed_against_the_prior():
    """One exposure for all, measured twice: the mean of a normal posterior, by hand."""
    error = torch.full((2, 3), math.inf).double()
    error[:, 1] = float64([0.1, 0.2])
    ratio = torch.zeros(2, 3).double()
    ratio[:, 1] = float64([1.0, 1.2])
    found = Nuisances.before((Unknown("exposure"),), 2).learning(ratio, error)
    precision = 1 / 0.1**2 + 1 / 0.2**2 + 1 / EXPOSURE_WIDTH**2
    assert float(found.mean) == pytest.approx((1.0 / 0.1**2 + 1.2 / 0.2**2) / precision)
    assert float(found.root) == pytest.approx(math.sqrt(precision))
    assert found.told.tolist() == [True]


def test_what_the_unknowns_cannot_explain_widens_the_errors():
    """Red, green and blue say 0, 1 and 2 with errors of 0.1: χ² is 200 for two degrees of freedom."""
    ratio, error = float64([[0.0, 1.0, 2.0]]), torch.full((1, 3), 0.1).double()
    found = Nuisances.before((Unknown("exposure", 0),), 1).learning(ratio, error)
    assert float(found.root) == pytest.approx(math.sqrt(3 / 1.0**2 + 1 / EXPOSURE_WIDTH**2))
    assert found.told.tolist() == [False]


def test_only_what_nothing_tells_is_moved_to_a_guess():
    error = torch.full((2, 3), math.inf).double()
    error[0] = 0.01
    known = Nuisances.before(EACH, 2).learning(torch.ones(2, 3).double(), error)
    moved = known.about(torch.full((2, 3), -3.0).double())
    assert float(moved.mean[0]) == pytest.approx(1, abs=1e-3)
    assert float(moved.mean[1]) == -3.0


def two_photographs(model, seen: torch.Tensor) -> Residuals:
    """Gold's pixels, the first third of them of one photograph, all others of another."""
    place = (torch.arange(len(seen)) > len(seen) // 3).long()
    unknowns = (*EACH, Unknown("white_balance", channel=2))
    gains = NuisanceFactors(Nuisances.before(unknowns, 2), place)
    coordinates = MetalCoordinates(WidthInterval(0.15, 0.4, logarithmic=True))
    return Residuals(model, coordinates, seen, even_whitening(1 / seen, 0.01), gains)


@pytest.fixture(scope="module")
def residuals() -> Residuals:
    surface, lighting = surface_of(16, 2), Lighting(studio(128), (), PRESETS["preview"])
    model = lighting.pixels(surface, body=False).under(lighting.table(surface, (0.15, 0.4, 5), 64))
    return two_photographs(model, model.radiance(gold(0.25)))


def somewhere(residuals: Residuals, away: float) -> torch.Tensor:
    start = torch.cat([residuals.coordinates.free(gold(0.25)), float64([0.3, -0.4, 0.2])])
    return start + away * torch.randn(10, generator=torch.Generator().manual_seed(2), dtype=torch.float64)


def test_condensed_photographs_have_the_pixels_own_sum_of_squares(residuals):
    """Gram's eigenvalues keep half of float64's digits."""
    around = somewhere(residuals, 0.0)
    weighed, short = residuals.robust_whitening(around), condensed(residuals, around)
    for away in (0.05, 0.1):
        x = somewhere(residuals, away)
        pixels = torch.einsum("prc,pc->pr", weighed, residuals.difference(x)).square().sum()
        expected = pixels + residuals.prior(x).square().sum()
        assert float(short(x).square().sum()) == pytest.approx(float(expected), rel=1e-7)


def test_their_jacobian_and_the_pixels_meet_finite_differences(residuals):
    """Central differences of step h err by h²/6 third derivatives and by rounding over h: 1e-8 of the values."""
    x, step = somewhere(residuals, 0.05), 1e-5
    short = condensed(residuals, x)
    for function, found in ((short, short.jacobian(x)), (residuals.difference, residuals.slope(x))):
        for i in range(len(x)):
            way = torch.zeros_like(x)
            way[i] = step
            expected = (function(x + way) - function(x - way)) / (2 * step)
            torch.testing.assert_close(found[..., i], expected, atol=1e-6 * float(found.abs().max()), rtol=0)


def exposed(kind: str, unknowns, factors, known: float | None) -> tuple[Fit, Covariance]:
    """A fit to pictures by its own model times factors; `known` is the error to which the surroundings tell these."""
    fidelity = replace(preset("preview"), samples=256, search_samples=64)
    problem = problem_of(TRUTHS[kind], surface_of(18, 2), studio(128), fidelity, samples=2048)
    count, generator = len(problem.observed.radiance), torch.Generator().manual_seed(6)
    place = torch.zeros(count, 3, dtype=torch.long)
    place[:, 0] = torch.arange(count) * len(factors) // count
    noise = 1 + 0.003 * torch.randn(count, 3, generator=generator, dtype=torch.float64)
    seen = problem.observed.radiance * float64(factors)[place[:, 0]] * noise
    nuisances = Nuisances.before(unknowns, len(factors))
    if known is not None:
        nuisances = nuisances.learning(float64(factors).log(), torch.full((len(factors), 3), known).double())
    observed = replace(problem.observed, radiance=seen, place=place)
    fit = fit_material(replace(problem, observed=observed, nuisances=nuisances), kind)
    return fit, sandwich_covariance(fit.residuals, fit.x)


@pytest.mark.parametrize("kind", ["metal", pytest.param("glossy", marks=pytest.mark.slow)])
def test_exposures_that_went_in_come_out(kind):
    """Hundredfold and threefold: found within five standard errors, the chance of a sound fit to fail in one of ten
    numbers being 6e-6; as known as the surroundings tell them or better."""
    factors = [[0.03] * 3, [0.01] * 3]
    fit, error = exposed(kind, EACH, factors, known=0.005)
    assert fit.solution.status == "converged"
    found = nuisance_estimates([(fit, error)], ["a", "b"])
    assert found is not None
    for record, factor in zip(found.records, (0.03, 0.01), strict=True):
        assert abs(record.value - factor) < 5 * record.stderr
        assert record.stderr < 0.0051 * factor
        assert record.determined
        assert record.by_surroundings
    key = F0 if kind == "metal" else COLOR
    truth = TRUTHS["metal"].f0 if kind == "metal" else TRUTHS["glossy"].color
    for number, true in zip(measured(fit, error, key), truth.tolist(), strict=True):
        assert number.stderr is not None
        assert abs(number.value - true) < 5 * number.stderr
        assert number.stderr < 0.02


def test_a_matte_objects_colour_is_not_known_without_its_exposure():
    """Half the light on twice the albedo is the same picture: the ratios of the channels alone are known, and the
    interval of each holds what the prior allows."""
    factors = [[0.2] * 3]
    fit, error = exposed("matte", (Unknown("exposure"),), factors, known=None)
    numbers = measured(fit, error, COLOR)
    truth = TRUTHS["matte"].color.tolist()
    assert numbers[1].value / numbers[0].value == pytest.approx(truth[1] / truth[0], rel=0.01)
    for number, true in zip(numbers, truth, strict=True):
        assert number.interval is not None
        assert number.interval[0] < true < number.interval[1]
        assert number.interval[1] > 1.5 * number.interval[0]
    found = nuisance_estimates([(fit, error)], ["a"])
    assert found is not None
    assert not found.records[0].determined
    assert found.records[0].interval95[0] < 0.2 < found.records[0].interval95[1]
    assert "not determined" in found.told[0]


def test_photographs_of_one_camera_share_their_errors():
    """Three exposures that nothing tells: their mean is known no better than each, but for a tenth of the variance."""
    found = Nuisances.before([Unknown("exposure", index) for index in range(3)], 3)
    covariance = torch.linalg.inv(found.root.T @ found.root)
    torch.testing.assert_close(covariance.diagonal(), torch.full((3,), EXPOSURE_WIDTH**2).double())
    assert float(covariance.mean()) == pytest.approx(EXPOSURE_WIDTH**2 * (0.9 + 0.1 / 3))


@pytest.mark.parametrize("kind", [pytest.param("metal", marks=pytest.mark.slow), "matte"])
def test_an_environment_that_is_turned_is_found_where_it_is(kind):
    """By four degrees, between two of those that are scanned; a sound fit fails with a chance of 6e-7 for each number.
    Shades of a matte ball tell it less well than lamps that a metal mirrors."""
    light, truth = studio(128), TRUTHS[kind]
    fidelity = replace(preset("preview"), samples=256, search_samples=64)
    turned = replace(light, rotation=4.0)
    problem = problem_of(truth, surface_of(20 if kind == "metal" else 12, 2), turned, fidelity, samples=2048)
    noise = torch.randn(problem.observed.radiance.shape, generator=torch.Generator().manual_seed(5)).double()
    observed = replace(problem.observed, radiance=problem.observed.radiance * (1 + 0.005 * noise))
    nuisances = Nuisances.before((Unknown("rotation", start=10.0),), 1)
    lighting = Lighting(light, (), fidelity)
    fit = fit_material(replace(problem, observed=observed, lighting=lighting, nuisances=nuisances), kind)
    error = sandwich_covariance(fit.residuals, fit.x)
    found = nuisance_estimates([(fit, error)], ["a"])
    assert found is not None
    assert fit.solution.status == "converged"
    assert abs(found.records[0].value - 14.0) < 5 * found.records[0].stderr
    assert found.records[0].stderr < 0.5
    torch.testing.assert_close(found.factors, torch.ones(1, 3).double())
    key = F0 if kind == "metal" else COLOR
    for number, true in zip(measured(fit, error, key), getattr(truth, key.name).tolist(), strict=True):
        assert number.stderr is not None
        assert abs(number.value - true) < 5 * number.stderr
        assert number.stderr < 0.02


def test_between_its_turns_the_environments_picture_is_the_one_that_turned():
    """Of gold at four fifths of a step of one degree, against a table of that turn. The lobe is fifteen times as wide:
    a parabola errs by next to nothing, and what is left of the difference is the tables' noise."""
    light, surface, angle = studio(128), surface_of(8), 0.8
    fidelity, levels = PRESETS["preview"], (0.15, 0.4, 3)

    def model(degrees: float) -> PixelModel:
        lighting = Lighting(replace(light, rotation=degrees), (), fidelity)
        return lighting.pixels(surface, body=False)

    def table(degrees: float) -> LightTable:
        return Lighting(replace(light, rotation=degrees), (), fidelity).table(surface, levels, 8192)

    between = turned([model(each) for each in TURNS]).under(joined([table(each) for each in TURNS]))
    assert isinstance(between, TurnedPixels)
    found = between.at(float64(angle)).radiance(gold(0.25))
    expected = model(angle).under(table(angle)).radiance(gold(0.25))
    moved = model(0.0).under(table(0.0)).radiance(gold(0.25)) - expected
    assert (found - expected).abs().median() < 0.3 * moved.abs().median()
    mixing = between.at(float64(angle)).mixing(gold(0.25))
    assert mixing is not None
    mixed = torch.einsum("pqc,qc->pc", between.mixed(slice(None)), mixing)
    torch.testing.assert_close(mixed, found)


def test_white_balance_that_went_in_comes_out():
    """Of both photographs alike; the numbers are of red and blue against green, within five standard errors."""
    factors = [[1.4, 1.0, 0.7]] * 2
    fit, error = exposed("metal", ALL[1:], factors, known=0.005)
    found = nuisance_estimates([(fit, error)], ["a", "b"])
    assert found is not None
    assert [record.channel for record in found.records] == ["red", "blue"]
    for record, factor in zip(found.records, (1.4, 0.7), strict=True):
        assert abs(record.value - factor) < 5 * record.stderr
    torch.testing.assert_close(found.factors, float64(factors), rtol=0.02, atol=0)
    torch.testing.assert_close(found.exposures, torch.ones(2).double())
