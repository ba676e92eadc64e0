"""Standard errors against closed forms and against repeated experiments."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch

from fit_material.fitter.least_squares.covariance import (
    Covariance,
    intervals95,
    is_determined,
    sandwich_covariance,
    standard_errors,
    unbiased,
)
from fit_material.shaders.materials.quantities import QUANTITIES

pytestmark = pytest.mark.fits

GENERATOR = torch.Generator().manual_seed(7)
X = torch.linspace(-1, 1, 200, dtype=torch.float64)
DESIGN = torch.stack([torch.ones_like(X), X], 1)


def noise(*shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=GENERATOR, dtype=torch.float64)


@dataclass(frozen=True)
class Line:
    """Residuals of a linear model, three equal channels each: what `Residuals` is for pixels."""

    design: torch.Tensor
    seen: torch.Tensor
    whitening: torch.Tensor
    halves: tuple[Line, ...] = ()
    rounding: torch.Tensor | None = None
    table: tuple = ()
    width: float = math.inf
    clusters: torch.Tensor | None = None

    @property
    def model(self) -> Line:
        return self

    @property
    def rounded(self) -> Line:
        return self if self.rounding is None else replace(self, design=self.design * (1 + self.rounding))

    def difference(self, x):
        return (self.design @ x)[:, None] - self.seen

    def slope(self, x):
        return self.design[:, None].expand(-1, 3, -1)

    def robust_whitening(self, x):
        return self.whitening

    def prior(self, x):
        return x / self.width if math.isfinite(self.width) else x[:0]


def line(seen: torch.Tensor, design: torch.Tensor = DESIGN, halves: tuple[Line, ...] = (), **options) -> Any:
    """The residuals; their halves are themselves where the design is known without noise."""
    whole = Line(design, seen, torch.eye(3).double().expand(len(seen), 3, 3), **options)
    return replace(whole, halves=halves or (whole, whole))


def least_squares(y: torch.Tensor, design: torch.Tensor = DESIGN) -> torch.Tensor:
    return torch.linalg.lstsq(design, y.mean(1, keepdim=True)).solution[:, 0]


def test_independent_noise_has_the_textbook_covariance():
    """σ² (AᵀA)⁻¹ of 20 000 points of three channels; a scatter from m points errs by √(2/m), 1 % of a variance."""
    x = torch.linspace(-1, 1, 20_000, dtype=torch.float64)
    design = torch.stack([torch.ones_like(x), x], 1)
    y = 2 + 3 * x[:, None] + 0.1 * noise(20_000, 3)
    found = sandwich_covariance(line(y, design), least_squares(y, design))
    expected = 0.1**2 / 3 * torch.linalg.inv(design.T @ design)
    torch.testing.assert_close(found.covariance.diagonal(), expected.diagonal(), rtol=0.05, atol=0)


def test_pixels_that_err_together_count_as_one():
    """Four times the same pixel is one: σ² (AᵀA)⁻¹ of the 5 000 that differ, to the scatter's 2 % of a variance."""
    x = torch.linspace(-1, 1, 5_000, dtype=torch.float64)
    design = torch.stack([torch.ones_like(x), x], 1)
    y = 2 + 3 * x[:, None] + 0.1 * noise(5_000, 3)
    again = torch.arange(5_000).repeat(4)
    found = sandwich_covariance(line(y[again], design[again], clusters=again), least_squares(y, design))
    expected = 0.1**2 / 3 * torch.linalg.inv(design.T @ design)
    torch.testing.assert_close(found.covariance.diagonal(), expected.diagonal(), rtol=0.1, atol=0)


def test_channels_that_share_their_noise_count_as_one():
    """Thrice the same number is one number: σ² (AᵀA)⁻¹, whatever the weights say."""
    x = torch.linspace(-1, 1, 20_000, dtype=torch.float64)
    design = torch.stack([torch.ones_like(x), x], 1)
    y = (2 + 3 * x + 0.1 * noise(20_000))[:, None].expand(-1, 3)
    found = sandwich_covariance(line(y, design), least_squares(y, design))
    expected = 0.1**2 * torch.linalg.inv(design.T @ design)
    torch.testing.assert_close(found.covariance.diagonal(), expected.diagonal(), rtol=0.05, atol=0)


def test_two_thirds_of_the_truths_lie_within_one_standard_error():
    """Noise that grows tenfold along the line, which the weights do not know. 2000 experiments × 2 parameters; a
    share p scatters by √(p(1-p)/2000) = 0.0104: four of these are allowed, and 0.01 for a scatter from 200 points."""
    inside = torch.zeros(2)
    for _ in range(2000):
        y = 2 + 3 * X[:, None] + (0.11 + 0.09 * X)[:, None] * noise(200, 3)
        x = least_squares(y)
        errors = standard_errors(lambda x: x, x, sandwich_covariance(line(y), x))
        inside += ((x - torch.tensor([2.0, 3.0])).abs() < errors).float()
    share = inside / 2000
    assert (share - math.erf(1 / math.sqrt(2))).abs().max() < 4 * 0.0104 + 0.01, share


def test_a_prior_is_what_is_left_where_nothing_is_seen():
    design = torch.stack([torch.ones_like(X), torch.zeros_like(X)], 1)
    y = 2 + 0.1 * noise(200, 3)
    found = sandwich_covariance(line(y, design, width=1.5), torch.tensor([2.0, 0.0], dtype=torch.float64))
    assert found.covariance[1, 1].sqrt().item() == pytest.approx(1.5, rel=1e-9)


def test_noise_in_the_table_is_no_bias():
    """y = 2 a, a known through two halves with noise of their own, σ = 0.3. Least squares with their mean finds
    2⟨a ā⟩/⟨ā²⟩ = 2/(1 + σ²/2), 0.086 too little; crossed slopes find 2, up to their chance of 2σ/√(3·20000)."""
    a = torch.ones(20_000, 1, dtype=torch.float64)
    first, second = (a + 0.3 * noise(20_000, 1) for _ in range(2))
    whole, seen = (first + second) / 2, 2 * a.expand(-1, 3)
    x = least_squares(seen, whole)
    assert x.item() == pytest.approx(2 / (1 + 0.3**2 / 2), abs=0.01)
    residuals = line(seen, whole, halves=(line(seen, first), line(seen, second)))
    assert unbiased(residuals, x).item() == pytest.approx(2, abs=5 * 2 * 0.3 / math.sqrt(20_000))


@dataclass(frozen=True)
class Bent(Line):
    """y = (20 + arctan x) a."""

    def difference(self, x):
        return (20 + torch.arctan(x)) * self.design - self.seen

    def slope(self, x):
        return (self.design / (1 + x**2))[:, None].expand(-1, 3, -1)


def test_a_bent_model_is_followed_to_where_crossed_slopes_end():
    """Beyond 1.39, steps along the tangent of arctan swing ever wider. Of halves 1 + σe and 1 + σe' with e, e' and 1
    orthogonal least squares finds 20 + arctan x = 20/(1 + σ²/2); crossed slopes find x = 0."""
    signs = torch.tensor([1.0, -1.0], dtype=torch.float64)
    first, second = (1 + 0.373 * each.repeat(20)[:, None] for each in (signs.repeat(2), signs.repeat_interleave(2)))
    whole, seen = (first + second) / 2, 20 * torch.ones(80, 1, dtype=torch.float64)
    whitening = torch.eye(3).double().expand(80, 3, 3) / (20 * 0.373 / math.sqrt(2))
    parts = (Bent(each, seen, whitening) for each in (whole, first, second))
    residuals: Any = replace(next(parts), halves=tuple(parts))
    start = torch.tan((whole * seen).sum() / whole.square().sum() - 20)[None]
    assert start < -3
    assert abs(unbiased(residuals, start).item()) < 0.01 / math.sqrt(3 * 80 * whitening[0, 0, 0] ** 2)


def test_what_needs_no_table_has_no_bias():
    x = torch.tensor([2.0, 3.0], dtype=torch.float64)
    assert unbiased(line(noise(200, 3), table=None), x) is x


def test_an_unseen_direction_has_a_huge_and_finite_error():
    design = torch.stack([torch.ones_like(X), torch.zeros_like(X)], 1)
    x = torch.tensor([2.0, 5.0], dtype=torch.float64)
    found = sandwich_covariance(line(2 + 0.1 * noise(200, 3), design), x)
    errors = standard_errors(lambda x: x, x, found)
    assert errors[0] < 0.02
    assert errors[1] > 1e5
    assert errors.isfinite().all()


def in_two_halves(pixels: int, of_noise: float, signal: float = 0.0) -> Any:
    """y = 2 + 0.1 of noise, by a constant and a number of which two halves show a signal and noise of their own."""
    shown = signal * (-1.0) ** torch.arange(pixels, dtype=torch.float64)[:, None]
    designs = [torch.cat([torch.ones_like(shown), shown + of_noise * noise(pixels, 1)], 1) for _ in range(2)]
    seen = 2 + 0.1 * noise(pixels, 3)
    return line(seen, (designs[0] + designs[1]) / 2, halves=tuple(line(seen, each) for each in designs))


@pytest.mark.parametrize("of_noise", [1e-9, 1e-3, 1.0])
def test_a_slope_that_is_noise_determines_nothing(of_noise):
    """However small or large it is; what it resembles by chance stays known: the constant, to 0.1/√(3·300)."""
    for _ in range(50):
        found = sandwich_covariance(in_two_halves(300, of_noise), torch.tensor([2.0, 0.0], dtype=torch.float64))
        of_constant, of_noisy = found.covariance.diagonal().sqrt()
        assert of_noisy > 1e6 / of_noise / math.sqrt(3 * 300)
        assert of_constant.item() == pytest.approx(0.1 / math.sqrt(3 * 300), rel=0.3)  # a scatter of 300: 6 sigma


def test_a_slope_that_stands_out_of_its_noise_is_known():
    """A slope s of 1 in as much noise e of each half: var = ⟨(s + ē)²⟩ σ²/⟨s²⟩² = 1.5 σ² of what it were without."""
    found = sandwich_covariance(in_two_halves(30_000, 1.0, 1.0), torch.tensor([2.0, 0.0], dtype=torch.float64))
    expected = math.sqrt(1.5) * 0.1 / math.sqrt(3 * 30_000)
    assert found.covariance[1, 1].sqrt().item() == pytest.approx(expected, rel=0.05)


def test_a_slope_within_the_tables_rounding_determines_nothing():
    """Both halves agree about it, and yet it is that of numbers that another processor rounds otherwise."""
    design = torch.stack([torch.ones_like(X), 1e-7 * noise(200)], 1)
    seen = 2 + 0.1 * noise(200, 3)
    own = torch.stack([torch.zeros_like(X), torch.ones_like(X)], 1)  # of the second number's slope: all of it
    half = replace(line(seen, design), rounding=own)
    found = sandwich_covariance(line(seen, design, halves=(half, half)), torch.tensor([2.0, 0.0], dtype=torch.float64))
    assert found.covariance[1, 1].sqrt() > 1e10


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_no_unit_is_rounding_beside_another(unit):
    """A number in a unit 10¹² times as small has 10¹² times the error, and no other one, in 24 decades of variance."""
    seen = 2 + 3 * X[:, None] + 0.1 * noise(200, 3)
    x = least_squares(seen)
    scale = torch.tensor([1.0, unit], dtype=torch.float64)
    plain, scaled = sandwich_covariance(line(seen), x), sandwich_covariance(line(seen, DESIGN * scale), x / scale)
    errors, of_scaled = (each.covariance.diagonal().sqrt() for each in (plain, scaled))
    torch.testing.assert_close(of_scaled * scale, errors, rtol=1e-9, atol=0)


def test_nothing_seen_at_all_is_finite():
    found = sandwich_covariance(line(noise(200, 3), torch.zeros(200, 2).double()), torch.zeros(2).double())
    assert found.covariance.isfinite().all()
    assert (found.covariance.diagonal() > 1e12).all()


def test_errors_of_a_function_follow_its_slope():
    """Of exp(2x) at x = 0.3 ± 0.01: 2 exp(0.6) · 0.01."""
    found = Covariance(torch.tensor([[1e-4]], dtype=torch.float64))
    error = standard_errors(lambda x: torch.exp(2 * x), torch.tensor([0.3], dtype=torch.float64), found)
    assert error.item() == pytest.approx(2 * math.exp(0.6) * 0.01, rel=1e-12)


def test_intervals_of_a_straight_line_are_symmetric():
    """Of 3x₀ - x₁ with variances 0.01, 0.04: ± 1.96 √(9·0.01 + 0.04)."""
    found = Covariance(torch.diag(torch.tensor([0.01, 0.04], dtype=torch.float64)))
    low, high = intervals95(lambda x: (3 * x[0] - x[1])[None], torch.tensor([1.0, 2.0], dtype=torch.float64), found)
    half = 1.959964 * math.sqrt(0.13)
    assert (low.item(), high.item()) == pytest.approx((1 - half, 1 + half), rel=1e-12)


def test_intervals_follow_a_curved_quantity_and_stay_in_its_domain():
    """Of exp(x) at 0 ± 2: exp(±3.92), which value ± 1.96·2 would put below zero."""
    found = Covariance(torch.tensor([[4.0]], dtype=torch.float64))
    low, high = intervals95(torch.exp, torch.zeros(1, dtype=torch.float64), found)
    assert (low.item(), high.item()) == pytest.approx((math.exp(-3.919928), math.exp(3.919928)), rel=1e-9)


@pytest.mark.parametrize(
    ("parameter", "value", "interval", "determined"),
    [
        ("n", 2.0, (1.81, 2.19), True),
        ("n", 2.0, (1.79, 2.21), False),
        ("k", 0.0, (0.0, 0.05), False),
        ("f0", 0.9, (0.6, 1.0), False),
    ],
)
def test_verdicts(parameter, value, interval, determined):
    assert is_determined(QUANTITIES[parameter].resolved, value, interval) is determined
