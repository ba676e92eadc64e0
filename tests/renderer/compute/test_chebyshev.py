"""Interpolation against numpy's Chebyshev module, polynomials and finite differences."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import chebyshev as reference

from fit_material.renderer.compute import chebyshev

counts, positions = st.integers(1, 20), st.floats(-1, 1)

# Lebesgue's constant of the extrema is below 2/π log(n) + 1 = 3 for 20 of them; so few ulps are lost
ROUNDING = 1e-13


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


@given(counts, positions)
def test_polynomials_are_numpys(count, x):
    found = chebyshev.polynomials(float64(x), count).numpy()
    np.testing.assert_allclose(found, reference.chebvander(x, count - 1)[0], atol=ROUNDING)


@given(counts)
def test_nodes_are_the_extrema(count):
    found = chebyshev.nodes(count).numpy()
    expected = reference.chebpts2(count) if count > 1 else [0.0]
    np.testing.assert_allclose(found, expected, atol=1e-15)


@given(counts, st.integers(0, 10**6))
def test_coefficients_are_numpys_and_pass_through_the_values(count, seed):
    values = np.random.default_rng(seed).normal(size=(count, 2, 3))
    at = chebyshev.nodes(count).numpy()
    found = chebyshev.coefficients(float64(values)).numpy()
    expected = reference.chebfit(at, values.reshape(count, 6), count - 1)
    np.testing.assert_allclose(found.reshape(count, 6), expected, atol=ROUNDING)
    np.testing.assert_allclose(reference.chebval(at, found), np.moveaxis(values, 0, -1), atol=1e-12)


@given(counts, positions, st.integers(0, 10**6))
def test_weights_are_exact_for_polynomials(count, x, seed):
    coefficients = np.random.default_rng(seed).normal(size=count)
    at_nodes = np.polyval(coefficients, chebyshev.nodes(count))
    weights = chebyshev.weights(float64(x), count).numpy()
    assert weights @ at_nodes == pytest.approx(np.polyval(coefficients, x), abs=1e-12)
    assert weights.sum() == pytest.approx(1, abs=ROUNDING)


@pytest.mark.parametrize("count", [1, 2, 5, 12])
def test_weights_pick_each_node(count):
    found = torch.stack([chebyshev.weights(node, count) for node in chebyshev.nodes(count)])
    torch.testing.assert_close(found, torch.eye(count).double(), atol=ROUNDING, rtol=0)


@pytest.mark.parametrize("count", [4, 8, 12])
def test_a_smooth_curve_converges_as_theory_says(count):
    """1/(x - 5/4) has its pole on the ellipse ρ = 2, so the error is at most 4Mρ⁻ⁿ/(ρ - 1) [Trefethen 2013, 8.2]."""
    x = np.linspace(-1, 1, 101)
    at_nodes = 1 / (chebyshev.nodes(count).numpy() - 1.25)
    found = [chebyshev.weights(float64(position), count).numpy() @ at_nodes for position in x]
    rho = 1.9  # inside, where |f| <= 1/(5/4 - (ρ + 1/ρ)/2)
    bound = 4 / (1.25 - (rho + 1 / rho) / 2) * rho ** (1 - count) / (rho - 1)
    error = np.abs(np.array(found) - 1 / (x - 1.25)).max()
    assert bound * 1e-4 < error < bound


@pytest.mark.parametrize("count", [1, 2, 7])
@pytest.mark.parametrize("x", [-1.0, -0.3, 0.0, 1.0])
def test_derivatives_meet_finite_differences(count, x):
    position = float64(x).requires_grad_()
    assert torch.autograd.gradcheck(lambda value: chebyshev.weights(value, count), position)
    values = torch.randn(count, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    assert torch.autograd.gradcheck(chebyshev.coefficients, values.requires_grad_())


def test_weights_keep_the_dtype_of_the_position():
    assert chebyshev.weights(torch.tensor(0.5), 5).dtype == torch.float32
    assert math.isclose(chebyshev.weights(torch.tensor(0.5), 5).sum().item(), 1, rel_tol=1e-6)
