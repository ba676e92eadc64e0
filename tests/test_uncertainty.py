"""Standard errors against closed forms and against repeated experiments."""

from __future__ import annotations

import math

import pytest
import torch

from fitter.uncertainty import Spread, intervals95, is_determined, spread, standard_errors

GENERATOR = torch.Generator().manual_seed(7)
X = torch.linspace(-1, 1, 200, dtype=torch.float64)
DESIGN = torch.stack([torch.ones_like(X), X], 1)


def residual_of(y: torch.Tensor, design: torch.Tensor = DESIGN):
    return lambda x: design @ x - y


def least_squares(y: torch.Tensor) -> torch.Tensor:
    return torch.linalg.lstsq(DESIGN, y[:, None]).solution[:, 0]


def test_straight_line_has_the_textbook_covariance():
    """s² (AᵀA)⁻¹ with s² = |r|²/(m - p), computed here by inverting AᵀA; its condition is 3, so rounding only."""
    y = 2 + 3 * X + 0.1 * torch.randn(200, generator=GENERATOR, dtype=torch.float64)
    x = least_squares(y)
    residual = residual_of(y)
    found = spread(residual, (residual, residual), x)
    expected = (residual(x) ** 2).sum() / 198 * torch.linalg.inv(DESIGN.T @ DESIGN)
    torch.testing.assert_close(found.covariance, expected, rtol=1e-9, atol=1e-15)


def test_two_thirds_of_the_truths_lie_within_one_standard_error():
    """2000 experiments × 2 parameters; a share p scatters by √(p(1-p)/2000) = 0.0104: four of these are allowed."""
    inside = torch.zeros(2)
    for _ in range(2000):
        y = 2 + 3 * X + 0.1 * torch.randn(200, generator=GENERATOR, dtype=torch.float64)
        x, residual = least_squares(y), residual_of(y)
        errors = standard_errors(lambda x: x, x, spread(residual, (residual, residual), x))
        inside += ((x - torch.tensor([2.0, 3.0])).abs() < errors).float()
    share = inside / 2000
    assert (share - math.erf(1 / math.sqrt(2))).abs().max() < 4 * 0.0104, share


def test_integration_error_is_how_far_the_other_half_would_move_the_parameters():
    """Noiseless data: the halves' tables differ by ∓d in the constant, so that each half's own minimum moves by ±d."""
    y = 2 + 3 * X
    halves = (residual_of(y - 0.01), residual_of(y + 0.01))
    found = spread(residual_of(y), halves, torch.tensor([2.0, 3.0], dtype=torch.float64))
    errors = standard_errors(lambda x: x, torch.tensor([2.0, 3.0], dtype=torch.float64), found)
    assert errors[0].item() == pytest.approx(0.01, rel=1e-9)
    assert errors[1].item() < 1e-12


def test_noise_in_the_table_shows_as_bias():
    """y = 2 a with a known through two noisy halves. Least squares with the whole finds 2⟨a²⟩/⟨ā²⟩-like attenuation,
    2 - β; with either half, whose noise variance is twice as large, 2 - 2β: the reported error holds β = 2σ²/2 for
    a noise of σ per half and a² = 1, within the sampling error of 20 000 products, 2 % of β here, and O(σ⁴)."""
    a = torch.ones(20000, dtype=torch.float64)
    noisy = [a + 0.3 * torch.randn(20000, generator=GENERATOR, dtype=torch.float64) for _ in range(2)]
    whole = (noisy[0] + noisy[1]) / 2

    def residual(table):
        return lambda x: table * x - 2 * a

    x = (2 * (whole * a).sum() / (whole**2).sum())[None]
    found = spread(residual(whole), (residual(noisy[0]), residual(noisy[1])), x)
    off = 2 - x.item()
    assert off == pytest.approx(2 * 0.3**2 / 2, rel=0.15)
    assert found.covariance[0, 0].sqrt().item() == pytest.approx(off, rel=0.25)


def test_an_unseen_direction_has_a_huge_and_finite_error():
    design = torch.stack([torch.ones_like(X), torch.zeros_like(X)], 1)
    residual = residual_of(2 + 0.1 * torch.randn(200, generator=GENERATOR, dtype=torch.float64), design)
    x = torch.tensor([2.0, 5.0], dtype=torch.float64)
    found = spread(residual, (residual, residual), x)
    errors = standard_errors(lambda x: x, x, found)
    assert errors[0] < 0.02
    assert errors[1] > 1e6
    assert errors.isfinite().all()


def test_errors_of_a_function_follow_its_slope():
    """Of exp(2x) at x = 0.3 ± 0.01: 2 exp(0.6) · 0.01."""
    found = Spread(torch.tensor([[1e-4]], dtype=torch.float64))
    error = standard_errors(lambda x: torch.exp(2 * x), torch.tensor([0.3], dtype=torch.float64), found)
    assert error.item() == pytest.approx(2 * math.exp(0.6) * 0.01, rel=1e-12)


def test_intervals_of_a_straight_line_are_symmetric():
    """Of 3x₀ - x₁ with variances 0.01, 0.04: ± 1.96 √(9·0.01 + 0.04)."""
    found = Spread(torch.diag(torch.tensor([0.01, 0.04], dtype=torch.float64)))
    low, high = intervals95(lambda x: (3 * x[0] - x[1])[None], torch.tensor([1.0, 2.0], dtype=torch.float64), found)
    half = 1.959964 * math.sqrt(0.13)
    assert (low.item(), high.item()) == pytest.approx((1 - half, 1 + half), rel=1e-12)


def test_intervals_follow_a_curved_quantity_and_stay_in_its_domain():
    """Of exp(x) at 0 ± 2: exp(±3.92), which value ± 1.96·2 would put below zero."""
    found = Spread(torch.tensor([[4.0]], dtype=torch.float64))
    low, high = intervals95(torch.exp, torch.zeros(1, dtype=torch.float64), found)
    assert (low.item(), high.item()) == pytest.approx((math.exp(-3.919928), math.exp(3.919928)), rel=1e-9)


@pytest.mark.parametrize(
    ("parameter", "value", "interval", "determined"),
    [
        ("n", 2.0, (1.8, 2.2), True),
        ("n", 2.0, (1.0, 3.1), False),
        ("k", 0.0, (0.0, 0.05), True),
        ("f0", 0.9, (0.6, 1.0), False),
    ],
)
def test_verdicts(parameter, value, interval, determined):
    assert is_determined(parameter, value, interval) is determined
