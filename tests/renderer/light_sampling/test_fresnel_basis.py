"""How few functions hold a metal's reflectance, against the exact curves and numpy's polynomials."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.light_sampling import fresnel_basis
from fit_material.renderer.materials.catalogue import read_catalogue
from fit_material.shaders.optics import fresnel

COS_D = torch.linspace(0, 1, 2001, dtype=torch.float64)
DOUBLE = torch.zeros((), dtype=torch.float64)


def conductor(n, k):
    n, k = (torch.tensor(number, dtype=torch.float64) for number in (n, k))
    return lambda cos_d: fresnel.conductor(cos_d, n, k)


def expanded(reflectance, degree: int) -> torch.Tensor:
    """The curve by its coefficients, [cosine, channel]."""
    found = fresnel_basis.coefficients(reflectance, degree, DOUBLE)
    return torch.einsum("bt,bc->tc", fresnel_basis.basis(COS_D, degree), found)


@pytest.mark.parametrize("metal", read_catalogue(), ids=lambda metal: metal.title)
def test_twelve_functions_hold_every_known_metal(metal):
    """To 1e-5, where 33 000 pixels of 1024 samples tell 1e-4 of a curve; polynomials in the cosine lack up to 9e-4."""
    curve = conductor(metal.n, metal.k)
    assert (expanded(curve, 12) - curve(COS_D[:, None])).abs().max() < 1e-5


def test_polynomials_in_the_cosine_would_not_do():
    curve = conductor((0.9,) * 3, (6.5,) * 3)(COS_D[:, None])[:, 0].numpy()
    cosine = COS_D.numpy()
    plain = np.polynomial.Chebyshev.fit(cosine, curve, 11, domain=(0, 1))(cosine)
    assert np.abs(plain - curve).max() > 3e-4


@given(st.floats(0.05, 10), st.floats(0.5, 10), st.integers(2, 20))
def test_no_more_is_missing_than_the_coefficients_left_out(n, k, degree):
    """Interpolation between extrema errs by twice the sum of the others at most [Trefethen 2013, eq. 4.9]; these are
    numpy's of a degree at which they have fallen to rounding."""
    curve = conductor((n,) * 3, (k,) * 3)

    def bent(z):
        x = (z + 1) / 2
        return curve(torch.from_numpy(0.3 * x / (1.3 - x))[:, None])[:, 0].numpy()

    left_out = np.abs(np.polynomial.chebyshev.chebinterpolate(bent, 200)[degree:]).sum()
    missing = (expanded(curve, degree) - curve(COS_D[:, None])).abs().max()
    assert missing <= 2 * left_out + 1e-12


@given(st.floats(0, 1), st.integers(1, 16))
def test_functions_stay_within_one(cosine, degree):
    found = fresnel_basis.basis(torch.tensor(cosine, dtype=torch.float64), degree)
    assert found[0] == 1
    assert found.abs().max() <= 1 + 1e-9  # the recurrence's rounding, degree² ulps
