"""Derivatives by two backward passes against torch's own forward ones, which share no rule with them."""

import subprocess
import sys

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.least_squares.jacobian import jacobian, jacobians
from fit_material.shaders.optics import fresnel

numbers = st.lists(st.floats(0.05, 20), min_size=6, max_size=6)

# Both are float64 products of the same some forty factors in another order.
ROUNDING = {"rtol": 1e-10, "atol": 1e-12}


def reflectance(x: torch.Tensor) -> torch.Tensor:
    """[11, 3], of n in x₀…₂ and k in x₃…₅."""
    return fresnel.conductor(torch.linspace(0, 1, 11).double()[:, None], x[:3], x[3:])


@given(numbers)
def test_jacobian_is_that_of_forward_derivatives(x):
    at = torch.tensor(x, dtype=torch.float64)
    torch.testing.assert_close(jacobian(reflectance, at), torch.func.jacfwd(reflectance)(at), **ROUNDING)


@given(st.lists(numbers, min_size=1, max_size=4))
def test_jacobians_are_those_of_each_place(points):
    at = torch.tensor(points, dtype=torch.float64)
    values, slopes = jacobians(lambda x: reflectance(x).flatten(), at)
    for x, value, slope in zip(at, values, slopes, strict=True):
        torch.testing.assert_close(value, reflectance(x).flatten(), **ROUNDING)
        torch.testing.assert_close(slope, torch.func.jacfwd(reflectance)(x).flatten(0, 1), **ROUNDING)


@pytest.mark.parametrize("function", [lambda x: x[:0], lambda x: torch.ones(2, 3)], ids=["empty", "constant"])
def test_what_does_not_depend_on_x_has_no_slope(function):
    found = jacobian(function, torch.ones(4, dtype=torch.float64))
    assert found.shape == (*function(torch.ones(4)).shape, 4)
    assert not found.any()


def test_one_infinite_slope_stays_in_its_own_row():
    found = jacobian(torch.sqrt, torch.tensor([0.0, 4.0], dtype=torch.float64))
    assert not found[0, 0].isfinite()
    assert found[1].tolist() == [0.0, 0.25]


def test_a_fit_does_not_wait_for_torchs_compiler():
    code = (
        "import sys, torch; from fit_material.fitter.least_squares.jacobian import jacobian, jacobians;"
        "jacobian(torch.sin, torch.ones(3)); jacobians(torch.sin, torch.ones(2, 3));"
        "assert 'torch._dynamo' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
