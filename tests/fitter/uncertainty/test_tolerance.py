"""A fit that climbs until its numbers are expected to keep to a tolerance."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.estimation.coarse_to_fine import Problem, fit_material
from fit_material.fitter.least_squares.covariance import integration_share
from fit_material.fitter.options.fidelity import PRESETS, Fidelity
from fit_material.fitter.uncertainty.tolerance import (
    AIM,
    FIRST_PIXELS,
    FIRST_SAMPLES,
    LAST_SAMPLES,
    Effort,
    Outlook,
    ascend,
    outlook_of,
    require_tolerance,
)
from fit_material.renderer.compute import chebyshev
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.synthesis.studio import studio
from tests.fitter.estimation.test_coarse_to_fine import gold, problem_of, surface_of

CHANNELS = {"red": 0, "green": 1, "blue": 2}
FEW = replace(PRESETS["standard"], footprint=2, search_pixels=500, pixels=FIRST_PIXELS, samples=FIRST_SAMPLES)


@pytest.fixture(scope="module")
def light() -> Environment:
    return studio(128)


def noisy(truth, light: Environment, noise: float, fidelity: Fidelity, samples: int = 4096) -> Problem:
    """Photographs of 32² by many samples, each value off by a normal error."""
    problem = problem_of(truth, surface_of(40, 2), light, fidelity, samples=samples)
    generator = torch.Generator().manual_seed(1)
    seen = problem.observed.radiance
    seen = seen * (1 + noise * torch.randn(seen.shape, generator=generator, dtype=torch.float64))
    return replace(problem, observed=replace(problem.observed, radiance=seen))


def of_effort(problem: Problem, fidelity: Fidelity) -> Problem:
    """The problem with as many of its pixels, drawn by chance, as the fidelity asks for."""
    order = torch.randperm(len(problem.observed.radiance), generator=torch.Generator().manual_seed(2))
    chosen = order[: fidelity.pixels]
    surface, radiance = problem.observed.surface[chosen], problem.observed.radiance[chosen]
    observed = replace(problem.observed, surface=surface, radiance=radiance, available=len(order))
    return Problem(observed, replace(problem.lighting, fidelity=fidelity), problem.solver, problem.progress)


outlooks = st.builds(
    lambda errors, integration, pixels, samples, more: Outlook(
        tuple(map(str, errors)),
        torch.tensor(errors, dtype=torch.float64),
        torch.zeros(len(errors), dtype=torch.float64),
        integration,
        Effort(pixels, samples, 5),
        pixels * more,
    ),
    st.lists(st.floats(1e-4, 0.1), min_size=1, max_size=10),
    st.floats(0, 1),
    st.integers(100, 10**5),
    st.integers(16, LAST_SAMPLES),
    st.integers(1, 50),
)
tolerances = st.floats(1e-4, 0.5)


@given(outlooks)
def test_errors_fall_with_the_root_of_the_pixels_and_of_what_samples_bring(outlook):
    """The variance of a mean over pixels, each of which has a fixed part and one that samples share."""
    now = outlook.effort
    more = Effort(4 * now.pixels, 9 * now.samples, now.levels)
    expected = outlook.movement**2 / 4 * ((1 - outlook.integration) + outlook.integration / 9)
    torch.testing.assert_close(outlook.foreseen(more) ** 2, expected)


@given(outlooks, tolerances)
def test_the_next_effort_is_the_cheapest_that_should_do(outlook, tolerance):
    further = outlook.next(tolerance)
    hopeful = outlook.foreseen(outlook.most()) <= tolerance
    if further is None:
        assert (outlook.movement[hopeful] <= tolerance).all()
        return
    assert (outlook.movement[hopeful] > tolerance).any()
    assert further.pixels >= outlook.effort.pixels or further.pixels == outlook.available
    assert further.samples >= outlook.effort.samples
    for each in outlook._efforts(tolerance):
        does = bool((outlook.foreseen(each)[hopeful] <= AIM * tolerance).all())
        assert not (does and each.cost < further.cost)


@given(outlooks, tolerances)
def test_numbers_that_noise_keeps_from_the_tolerance_drive_no_effort(outlook, tolerance):
    """A number whose photographs alone leave more than the tolerance, beside others that are within."""
    beyond = tolerance / 2 * (outlook.available / outlook.effort.pixels) ** 0.5 + 1
    errors = torch.tensor([tolerance / 5, beyond], dtype=torch.float64)
    assert (
        replace(outlook, names=("a", "b"), error=errors, interpolation=0 * errors, integration=0.0).next(tolerance)
        is None
    )


@pytest.mark.slow  # two climbs
def test_a_climb_spends_more_where_more_is_asked_and_keeps_its_word(light):
    """Each determined number off by less than twice what was promised of it, which is 4.8 standard errors."""
    truth = gold(0.2)
    problem = noisy(truth, light, 0.002, FEW)
    spent, ascents = [], []
    for tolerance in (0.2, 0.02):
        ascent = ascend(lambda fidelity: of_effort(problem, fidelity), FEW, "metal", tolerance)
        last, found = ascent.rungs[-1], ascent.choice.fit.material
        assert last.movement is not None
        assert ascent.reached == (last.movement <= tolerance)
        assert ascent.reached or ascent.hopeless
        assert f"{100 * tolerance:.3g} %" in ascent.sentence
        assert "roughness" not in " ".join([*ascent.hopeless, *(rung.of or "" for rung in ascent.rungs)])
        outlook = outlook_of(ascent.choice.fit, ascent.problem)
        assert float(outlook.movement.max()) == last.movement
        for name, movement in zip(outlook.names, outlook.movement.tolist(), strict=True):
            key, _, channel = name.partition(" of ")
            value, true = (
                {"f0": each.f0, **each.numbers}[key].reshape(-1)[CHANNELS.get(channel, 0)] for each in (found, truth)
            )
            assert abs(value / true - 1) < 2 * movement
        spent.append(last.pixels * last.samples)
        ascents.append(ascent)
    assert spent[0] < spent[1]
    rough, fine = ascents
    followed = fine.followed_by(rough.choice.fit, rough.problem)  # what is promised is of the fit that is reported
    assert followed.rungs[-1].movement == rough.rungs[-1].movement != fine.rungs[-1].movement
    assert followed.record("ball").reached == (rough.rungs[-1].movement <= fine.asked)


@pytest.mark.parametrize(
    "noise", [pytest.param(0.0, marks=pytest.mark.slow), pytest.param(0.1, marks=pytest.mark.slow), 0.3]
)
def test_the_integrations_share_is_what_other_samples_make_of_the_pixels(light, noise):
    """Against the scatter between pictures of three seeds, relative to radiance, where the share weighs pixels and
    channels by what they tell: within a factor of three."""
    few, truth = replace(FEW, samples=64), gold(0.2)
    problem = noisy(truth, light, noise, few)
    fit = fit_material(problem, "metal")
    seeds = [replace(problem.lighting, seed=seed).radiance(truth, problem.observed.surface, 64) for seed in (1, 2, 3)]
    integration = torch.stack(seeds).div(problem.observed.radiance).var(0).median(0).values.mean()
    expected = float(integration / (integration + noise**2))
    assert expected / 3 < integration_share(fit.residuals, fit.x) < min(1.0, 3 * expected) + 1e-9


@given(st.integers(2, 9), st.integers(0, 10**6))
def test_without_the_highest_polynomial_a_curve_of_lower_degree_is_as_it_was(levels, seed):
    generator = torch.Generator().manual_seed(seed)
    coefficients = torch.randn(levels, generator=generator, dtype=torch.float64)
    curve = chebyshev.polynomials(chebyshev.nodes(levels), levels).T @ coefficients
    table = LightTable(curve.reshape(1, levels, 1, 1, 1).expand(2, -1, 3, 4, 3), 0.1, 0.2, "log")
    torch.testing.assert_close(table.without_highest().light, table.light - coefficients[-1])


@pytest.mark.parametrize("tolerance", [0.0, -0.1, 1.0, float("nan"), float("inf")])
def test_tolerances_that_mean_nothing_are_refused(tolerance):
    with pytest.raises(InputError, match="--tolerance"):
        require_tolerance(tolerance, FEW)


def test_the_viewers_blur_promises_nothing():
    with pytest.raises(InputError, match="blur"):
        require_tolerance(0.01, PRESETS["viewer"])
