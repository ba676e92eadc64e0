"""Ambient light against cosine integrals and Legendre series; the energy guard against its formula in plain loops."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import sph_harm_y

from fit_material.shaders.optics import diffuse

EPS64 = 2.0**-52


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def some_normals(count: int = 12) -> torch.Tensor:
    drawn = torch.randn(count, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    return torch.nn.functional.normalize(drawn, dim=-1)


def sphere_quadrature(order: int = 12) -> tuple[torch.Tensor, torch.Tensor]:
    """Directions and weights that integrate polynomials of degree 2·order - 1 exactly over the sphere."""
    cosine, weight = (float64(values) for values in np.polynomial.legendre.leggauss(order))
    phi = torch.arange(2 * order, dtype=torch.float64) * math.pi / order
    sine = (1 - cosine**2).sqrt()[:, None]
    towards = torch.stack([sine * phi.cos(), sine * phi.sin(), cosine[:, None].expand(-1, len(phi))], -1)
    return towards.reshape(-1, 3), (weight[:, None] * math.pi / order).expand(-1, len(phi)).flatten()


def cosine_mean(radiance, normal: torch.Tensor) -> torch.Tensor:
    """∫ L(l) max(0, n·l)/π dl by Gauss's rule over the hemisphere around n, where the cosine is a polynomial."""
    cosine, weight = (float64(values) for values in np.polynomial.legendre.leggauss(12))
    cosine, weight = (cosine + 1) / 2, weight / 2
    phi = torch.arange(16, dtype=torch.float64) * math.pi / 8
    across = torch.nn.functional.normalize(torch.linalg.cross(normal, normal.new_tensor([0.6, -0.8, 0.1])), dim=0)
    third = torch.linalg.cross(normal, across)
    sine = (1 - cosine**2).sqrt()[:, None, None]
    ring = phi.cos()[:, None] * across + phi.sin()[:, None] * third
    found = radiance(cosine[:, None, None] * normal + sine * ring)
    return torch.einsum("t,tpc->c", weight * cosine * (math.pi / 8) / math.pi, found)


def test_harmonics_are_scipys():
    """Scipy's complex Y_lm with the Condon-Shortley phase, made real."""
    towards = some_normals()
    x, y, z = towards.numpy().T
    theta, phi = np.arccos(z), np.arctan2(y, x)
    real = [
        math.sqrt(2) * (-1) ** m * (sph_harm_y(degree, abs(m), theta, phi).imag if m < 0
        else sph_harm_y(degree, m, theta, phi).real) if m else sph_harm_y(degree, 0, theta, phi).real
        for degree, m in ((0, 0), (1, -1), (1, 0), (1, 1), (2, -2), (2, -1), (2, 1), (2, 0), (2, 2))
    ]  # fmt: skip
    constants = [0.282095, *[0.488603] * 3, *[1.092548] * 3, 0.315392, 0.546274]  # [Ramamoorthi & Hanrahan 2001, eq. 3]
    found = diffuse.harmonics(towards).numpy() * constants
    np.testing.assert_allclose(found, np.stack(real, -1), atol=2e-6)  # the paper prints six digits


def test_ambient_light_is_the_cosine_weighted_mean():
    """Exactly, for surroundings that the nine harmonics can tell."""
    mixture = torch.randn(9, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    mixture[0] = 12.0  # so that the radiance is positive everywhere and nothing is cut off

    def radiance(towards):
        return diffuse.harmonics(towards) @ mixture

    towards, weights = sphere_quadrature()
    assert radiance(towards).min() > 0
    moments = torch.einsum("p,pi,pc->ic", weights, diffuse.harmonics(towards), radiance(towards))
    coefficients = diffuse.ambient_coefficients(moments)
    for normal in some_normals():
        found = diffuse.ambient(coefficients, normal)
        torch.testing.assert_close(found, cosine_mean(radiance, normal), rtol=64 * EPS64, atol=0)


@given(st.floats(-1, 1))
def test_a_lamp_is_spread_by_the_first_terms_of_the_cosine_lobe(cosine):
    """max(0, c) ≈ 1/4 + c/2 + 5/16 P₂(c), its Legendre series; below 0 it is cut off."""
    lamp, normal = float64([0.0, 0.6, 0.8]), float64([1.0, 0.0, 0.0])
    normal = cosine * lamp + math.sqrt(1 - cosine**2) * normal
    irradiance = float64([1.0, 2.0, 5.0])
    coefficients = diffuse.ambient_coefficients(diffuse.harmonics(lamp)[:, None] * irradiance)
    series = 1 / 4 + cosine / 2 + 5 / 32 * (3 * cosine**2 - 1)
    expected = irradiance / math.pi * max(0.0, series)
    torch.testing.assert_close(diffuse.ambient(coefficients, normal), expected, rtol=0, atol=64 * EPS64)
    assert abs(series - max(0.0, cosine)) <= 0.1  # what nine numbers can do for a lamp


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_constant_light_is_the_same_from_everywhere(dtype):
    radiance = torch.tensor([0.1, 1.0, 30.0], dtype=dtype)
    found = diffuse.ambient(diffuse.constant_ambient(radiance), some_normals().to(dtype))
    assert found.dtype == dtype
    assert (found == radiance).all()
    moments = torch.zeros(9, 3).double()
    moments[[0, 7]] = 4 * math.pi * torch.tensor([[1.0], [0.0]]).double()  # ∫ 1 and ∫ 3z²-1 of a white sky
    found = diffuse.ambient(diffuse.ambient_coefficients(moments), some_normals())
    torch.testing.assert_close(found, torch.ones_like(found), rtol=8 * EPS64, atol=0)


shares = st.one_of(st.floats(0, 1), st.sampled_from([0.0, 1e-300, 1e-40, 1e-9, 0.5, 1 - 2**-24, 1 - 2**-53, 1.0]))
triples = st.tuples(shares, shares, shares)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@given(triples, triples)
def test_guarded_bodies_return_no_more_than_arrives(dtype, color, reflectance):
    color, f = (torch.tensor(values, dtype=dtype).requires_grad_() for values in (color, reflectance))
    found = diffuse.energy_guard(color, f)
    eps = torch.finfo(dtype).eps
    assert ((found >= 0) & (found + f <= 1 + 2 * eps)).all()
    assert (found <= color).all()
    if (color + f <= 1).all():
        assert (found == color).all()
    else:
        assert (found + f).max() >= 1 - 4 * eps  # no darker than need be
    for gradient in torch.autograd.grad(found.sum(), (color, f)):
        assert gradient.isfinite().all()


@given(triples, st.tuples(*[st.floats(0, 0.999)] * 3))
def test_the_guard_is_one_division_that_keeps_the_hue(color, reflectance):
    divisor = max([1.0, *(c / (1 - f) for c, f in zip(color, reflectance, strict=True))])
    expected = float64([c / divisor for c in color])
    found = diffuse.energy_guard(float64(color), float64(reflectance))
    # color + F > 1 is decided after rounding: there 1 - F, down to 1e-3, has lost ε/1e-3 of itself
    torch.testing.assert_close(found, expected, rtol=1e3 * 4 * EPS64, atol=0)


def test_the_guards_corners():
    def guarded(color: float, f: float) -> float:
        return diffuse.energy_guard(float64([color, 0.0, 0.0]), float64([f, 0.0, 0.0]))[0].item()

    for color in (0.0, 0.25, 0.5, 0.75, 1.0):
        assert guarded(color, 1 - color) == color  # color + F = 1 exactly
        assert guarded(color, 1.0) == 0  # all is reflected
        assert guarded(color, 0.0) == color


@pytest.mark.parametrize("f", [(0.04, 0.05, 0.06), (0.5, 0.45, 0.4), (0.9, 0.95, 0.97)])
def test_derivatives_of_the_guard_meet_finite_differences(f):
    color = float64([0.55, 0.3, 0.7]).requires_grad_()
    assert torch.autograd.gradcheck(diffuse.energy_guard, (color, float64(f).requires_grad_()))
