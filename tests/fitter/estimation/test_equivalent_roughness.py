"""What explains photographs as well as the best, and how far that lets the rest move."""

from __future__ import annotations

import math

import pytest
import torch

from fit_material.fitter.estimation.equivalent_roughness import Alike, as_good


def test_models_that_differ_by_chance_are_as_good():
    """Squares of 1000 normal deviations each; of models that differ by their own noise, one in twenty is left out."""
    generator = torch.Generator().manual_seed(2)
    squares = torch.randn(200, 1000, generator=generator, dtype=torch.float64).square()
    against_first = [bool(as_good(squares[[0, each]]).all()) for each in range(1, 200)]
    assert sum(against_first) > 0.85 * 199


def test_a_model_that_errs_by_a_third_of_the_noise_is_not():
    """d = 2 r b + b² with b = 0.3: by 1000 · 0.09 = 90 in the mean, of which 1.96 · 0.6 √1000 = 37 were chance."""
    r = torch.randn(1000, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    assert as_good(torch.stack([r.square(), (r + 0.3).square()])).tolist() == [True, False]


def test_a_perfect_fit_is_as_good_as_another():
    assert as_good(torch.tensor([[1e-12], [2e-12]], dtype=torch.float64)).all()


def test_what_may_move_has_the_error_of_an_even_distribution():
    """To ± 3 and ∓ 6, together: 3/√3, 6/√3, correlated by -1; what stays has none."""
    moved = torch.tensor([[0.0, 0.0, 0.0], [1.0, -2.0, 0.0], [3.0, -6.0, 0.0]], dtype=torch.float64)
    covariance = Alike((0.1, 0.2), moved).covariance
    torch.testing.assert_close(covariance.diagonal().sqrt(), torch.tensor([3.0, 6.0, 0.0]).double() / math.sqrt(3))
    assert float(covariance[0, 1]) == pytest.approx(-18 / 3)
