"""Profile intervals against closed forms, brute force, scipy's constrained optimiser and repeated experiments."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from fit_material.fitter.least_squares.covariance import TWO_SIDED_95, Covariance, intervals95
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.uncertainty.profile_likelihood import intervals, profiled
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.optics import fresnel

PRECISION = torch.tensor([[3.0, 0.5], [0.2, 0.4], [-1.0, 0.3]], dtype=torch.float64)  # A: rows of a small problem
COVARIANCE = torch.linalg.inv(PRECISION.T @ PRECISION)
CLOSE = 0.03  # of a half width: an end is searched for within 2 % of its distance, and within 4 % of its deviance

Function = Callable[[torch.Tensor], torch.Tensor]


def float64(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def bent(x: torch.Tensor, bend: float) -> torch.Tensor:
    """θ(x): a straight valley in θ is a banana in x."""
    return torch.stack([x[0], x[1] + bend * x[0] ** 2])


def banana(bend: float) -> Function:
    """R = A θ(x), least at x = 0, where θ's Jacobian is 1."""
    return lambda x: PRECISION @ bent(x, bend)


def half_widths(covariance: torch.Tensor = COVARIANCE) -> torch.Tensor:
    return TWO_SIDED_95 * covariance.diagonal().sqrt()


def assert_ends(found: tuple[torch.Tensor, torch.Tensor], low: torch.Tensor, high: torch.Tensor) -> None:
    """Within `CLOSE` of the distance between expected ends."""
    error = torch.stack([found[0] - low, found[1] - high]).abs() / (high - low)
    assert (error < CLOSE).all(), f"{found} for {low}, {high}"


def test_the_profile_of_a_straight_valley_is_the_ellipse():
    x, covariance = float64(0.3, -0.2), 1.7 * COVARIANCE
    found = profiled(lambda y: PRECISION @ (y - x), x, Covariance(covariance), lambda y: y)
    torch.testing.assert_close(found[0], x - half_widths(covariance), rtol=1e-12, atol=0)
    torch.testing.assert_close(found[1], x + half_widths(covariance), rtol=1e-12, atol=0)


@pytest.mark.parametrize("bend", [0.3, 2.0, -5.0])
@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_profiles_do_not_depend_on_the_coordinates(bend, scale):
    """What is θ ± 1.96 σ in coordinates in which the residuals are linear is so in all others; where the sandwich is
    four times the inverse information, ends are twice as far."""
    covariance = scale * COVARIANCE
    found = profiled(banana(bend), torch.zeros(2).double(), Covariance(covariance), lambda x: bent(x, bend))
    assert_ends(found, -half_widths(covariance), half_widths(covariance))


@pytest.mark.parametrize("bend", [0.3, 2.0, -5.0])
def test_a_banana_is_followed_to_its_tips(bend):
    """x₁ = θ₁ - b θ₀² is extreme on the rim of the region, an ellipse in θ: looked for at 100 000 places of it, for
    both ends of either number. κ differs by none: the covariance is the inverse information."""
    x = torch.zeros(2).double()
    found = profiled(banana(bend), x, Covariance(COVARIANCE), lambda x: x)
    angle = torch.linspace(0, 2 * math.pi, 100_000, dtype=torch.float64)
    rim = TWO_SIDED_95 * torch.linalg.cholesky(COVARIANCE) @ torch.stack([angle.cos(), angle.sin()])
    numbers = torch.stack([rim[0], rim[1] - bend * rim[0] ** 2])
    assert_ends(found, numbers.amin(1), numbers.amax(1))
    if abs(bend) > 1:  # there the ellipse lies, or this would show nothing
        with pytest.raises(AssertionError):
            assert_ends(intervals95(lambda x: x, x, Covariance(COVARIANCE)), numbers.amin(1), numbers.amax(1))


@pytest.mark.parametrize("value", [0.0, 0.05, -0.4])
def test_a_quantity_is_followed_over_its_peak(value):
    """q = -x², σ = 1: by its slope at x it would hardly move. From -(|x| + 1.96)² to 0."""
    x = float64(value)
    found = profiled(lambda y: y - x, x, Covariance(torch.eye(1).double()), lambda y: -(y**2))
    assert_ends(found, -((x.abs() + TWO_SIDED_95) ** 2), float64(0.0))


def test_a_vector_that_is_not_the_minimum_is_the_centre():
    """What moves the minimum away from x is taken off: R = A (x - c) has θ ± 1.96 σ around any x, not around c."""
    x, minimum = float64(0.3, -0.2), float64(0.35, 0.1)
    bend = 2.0

    def residual(y: torch.Tensor) -> torch.Tensor:
        return PRECISION @ (bent(y - x, bend) - minimum)

    found = profiled(residual, x, Covariance(COVARIANCE), lambda y: bent(y - x, bend))
    assert_ends(found, -half_widths(), half_widths())


def test_a_domain_ends_where_the_deviance_is_never_reached():
    """R = ½ tanh x has at most D < 0.4, less than κ χ² = 0.9: q = sigmoid x fills its domain but for 2 % at either end,
    where the ellipse would leave 10 %."""
    found = profiled(lambda x: 0.5 * x.tanh(), float64(0.2), Covariance(torch.eye(1).double()), torch.sigmoid)
    assert found[0].item() < 0.02
    assert found[1].item() > 0.98


def test_nothing_known_keeps_the_ellipse():
    """No residual moves: its variance is none's multiple, and the ends are the ellipse's, finite."""
    x, unknown = float64(0.2, 0.1), Covariance(1e14 * torch.eye(2).double())
    found = profiled(lambda y: 0.0 * y, x, unknown, torch.sigmoid)
    torch.testing.assert_close(found, intervals95(torch.sigmoid, x, unknown))
    assert torch.stack(found).isfinite().all()


def test_what_is_not_finite_beyond_a_wall_is_not_entered():
    """R = log(1 + x) ends at x = -1; D = 3.84 at x = exp(±1.96) - 1, which is inside."""
    found = profiled(lambda x: torch.log(1 + x), float64(0.0), Covariance(torch.eye(1).double()), lambda x: x)
    assert_ends(found, float64(math.expm1(-TWO_SIDED_95)), float64(math.expm1(TWO_SIDED_95)))


@pytest.mark.parametrize(("n", "k"), [(2.9, 3.0), (0.9, 2.0), (0.15, 3.6)])
def test_a_metal_seen_from_nearby_angles_has_the_ends_of_a_grid(n, k):
    """Reflectance to 1 % from 0° to 60°, which leaves n and k of a channel on a bent valley; k turns round where n = 1.
    Channels know nothing of each other: the first one's region is looked for on a grid of F0 and tint, in steps
    of 0.0002 and 0.007."""
    coordinates = MetalCoordinates(WidthInterval(0.1, 0.4))
    metal = Metal(float64(n, n, n), float64(k, k, k), Microfacet(float64(0.2)[0]))
    x, cos_d = coordinates.free(metal), torch.linspace(0.5, 1, 6, dtype=torch.float64)
    seen = fresnel.conductor(cos_d[:, None], metal.n, metal.k)

    def residual(y: torch.Tensor) -> torch.Tensor:
        found = coordinates.material(y)
        curve = fresnel.conductor(cos_d[:, None], found.n, found.k)
        return torch.cat([100 * (curve - seen).flatten(), y[3:] - x[3:]])

    slope = torch.func.jacrev(residual)(x)
    spread = Covariance(torch.linalg.inv(slope.T @ slope))
    f0 = torch.logit(metal.f0[0] + torch.linspace(-0.03, 0.03, 301).double().clamp_max(0.999 - metal.f0[0]))
    grid = torch.cartesian_prod(f0, x[3] + torch.linspace(-2, 2, 601).double())
    places = x.repeat(len(grid), 1)
    places[:, 0], places[:, 3] = grid.T
    metals = torch.func.vmap(lambda y: torch.stack([(m := coordinates.material(y)).n[0], m.k[0]]))(places)
    inside = torch.func.vmap(residual)(places).square().sum(1) <= TWO_SIDED_95**2
    for key, values in zip(("n", "k"), metals[inside].T, strict=True):
        found = profiled(residual, x, spread, lambda y, key=key: getattr(coordinates.material(y), key)[:1])
        assert_ends(found, values.min(), values.max())


def test_what_cannot_be_condensed_keeps_the_ellipse():
    @dataclass
    class Fit:
        x: torch.Tensor
        condensate: None = None

    fit: Any = Fit(float64(0.3, -0.2))
    found = intervals(fit, Covariance(COVARIANCE), torch.exp)
    torch.testing.assert_close(found, intervals95(torch.exp, fit.x, Covariance(COVARIANCE)), rtol=0, atol=0)


NUMBERS = st.floats(-3, 3)


@settings(max_examples=25)
@given(st.lists(NUMBERS, min_size=6, max_size=6), st.tuples(NUMBERS, NUMBERS), NUMBERS, st.floats(0.1, 30))
def test_ends_are_finite_and_in_order_and_hold_the_value(rows, x, bend, scale):
    """Of any rows, rank 0 and 1 among them, with a spread as `uncertainty.spread` states it: huge where nothing is
    known."""
    design, x = float64(*rows).reshape(3, 2), float64(*x)
    known, ways = torch.linalg.eigh(design.T @ design)
    variance = torch.where(known > 1e-12, scale / known.clamp_min(1e-12), 1e14)

    def quantity(y: torch.Tensor) -> torch.Tensor:
        return torch.cat([torch.sigmoid(y), torch.tanh(y[:1] * y[1:])])

    low, high = profiled(lambda y: design @ bent(y - x, bend), x, Covariance(ways * variance @ ways.T), quantity)
    assert torch.cat([low, high]).isfinite().all()
    assert (low <= quantity(x)).all()
    assert (quantity(x) <= high).all()


TIMES = torch.linspace(0.05, 1.2, 12, dtype=torch.float64)
TRUTH = float64(1.0, 0.0)  # logarithms of amplitude and rate
NOISE, BELIEVED = 0.05, 0.025  # twice what the weights hold it for


def growth(x: torch.Tensor) -> torch.Tensor:
    """a (1 - exp(-b t)), seen while it still grows nearly straight: a and 1/b go together."""
    return x[0].exp() * -torch.expm1(-x[1].exp() * TIMES)


def growth_slope(x: np.ndarray) -> np.ndarray:
    a, bt = np.exp(x[0]), np.exp(x[1]) * TIMES.numpy()
    return np.stack([-a * np.expm1(-bt), a * bt * np.exp(-bt)], 1) / BELIEVED


@pytest.mark.slow
def test_95_of_100_intervals_hold_the_truth():
    """400 experiments whose noise is twice what the weights say, which the sandwich knows. A share of 0.95 scatters by
    √(0.95·0.05/400) = 0.011, each side's misses of 0.025 by 0.0078; three of these."""
    generator = torch.Generator().manual_seed(3)
    misses = torch.zeros(2, 2)
    for _ in range(400):
        seen = growth(TRUTH) + NOISE * torch.randn(len(TIMES), generator=generator, dtype=torch.float64)

        def residual(x: torch.Tensor, seen: torch.Tensor = seen) -> torch.Tensor:
            return (growth(x) - seen) / BELIEVED

        best = least_squares(lambda x: residual(torch.from_numpy(x)).numpy(), TRUTH.numpy(), jac=growth_slope).x  # type: ignore[arg-type]
        information = torch.from_numpy(growth_slope(best).T @ growth_slope(best))
        spread = Covariance((NOISE / BELIEVED) ** 2 * torch.linalg.inv(information))
        low, high = profiled(residual, torch.from_numpy(best), spread, torch.exp)
        misses += torch.stack([TRUTH.exp() < low, TRUTH.exp() > high]).float() / 400
    assert (misses.sum(0) - 0.05).abs().max() < 3 * 0.011, misses
    assert (misses - 0.025).abs().max() < 3 * 0.0078, misses
