"""Rules of quadrature, computed when they are first needed."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch

from fit_material.shaders.optics import quadrature, rough_plastic

COMPUTED = """
import torch
from fit_material.shaders.optics import quadrature
def computed(*_):
    raise AssertionError("at import")
torch.linalg.eigh = computed
from fit_material.shaders.optics import rough_plastic
"""


def test_nothing_is_computed_at_import():
    """Commands that fit no glossy material pay for no rule."""
    assert subprocess.run([sys.executable, "-c", COMPUTED], check=False).returncode == 0


def test_a_rule_is_computed_once():
    rule = quadrature.computed_once(quadrature.legendre, 5)
    assert rule() is rule()
    for kept, fresh in zip(rule(), quadrature.legendre(5), strict=True):
        assert kept.dtype == torch.float64
        assert torch.equal(kept, fresh)


@pytest.mark.parametrize("derivative", [torch.func.jacfwd, torch.func.jacrev, torch.func.grad])
def test_a_rule_first_needed_inside_a_derivative_is_whole_outside(derivative, monkeypatch):
    """There every tensor that is computed belongs to the derivative, and outside it is dead."""
    eta, alpha = torch.tensor([1.5, 0.2], dtype=torch.float64)

    def reflected(eta: torch.Tensor) -> torch.Tensor:
        return rough_plastic.diffuse_internal_reflectance(eta, alpha, "ggx")

    slope, value = derivative(reflected)(eta), reflected(eta)
    monkeypatch.setattr(rough_plastic, "_OUTSIDE", quadrature.computed_once(quadrature.legendre, 16))
    assert torch.equal(derivative(reflected)(eta), slope)
    assert torch.equal(reflected(eta), value)
    for kept, fresh in zip(rough_plastic._OUTSIDE(), quadrature.legendre(16), strict=True):
        assert torch.equal(kept, fresh)
