"""Fresnel's equations against complex arithmetic, Snell's law, Mitsuba, closed forms and finite differences."""

import math

import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from fit_material.renderer.materials.catalogue import read_catalogue
from fit_material.renderer.mitsuba.conversion import mitsuba
from fit_material.shaders.optics import fresnel

COSINES = [0.0, 1e-8, 1e-3, 0.1, 0.5, 0.8, 0.999, 1.0]
EPS32, EPS64 = 2.0**-23, 2.0**-52

cosines = st.one_of(st.sampled_from(COSINES), st.floats(0, 1))
refractive = st.floats(0.01, 20)
extinctions = st.one_of(st.just(0.0), st.floats(0, 20))


def float64(*values: float) -> list[torch.Tensor]:
    return [torch.tensor(value, dtype=torch.float64) for value in values]


def amplitudes(cos_d: float, n: float, k: float) -> float:
    """F from Fresnel's amplitude coefficients with the complex cosine of refraction, in 80-bit arithmetic."""
    cos_d, eta = np.longdouble(cos_d), np.clongdouble(complex(n, k))
    refracted = np.sqrt(1 - (1 - cos_d**2) / eta**2)
    s = (cos_d - eta * refracted) / (cos_d + eta * refracted)
    p = (eta * cos_d - refracted) / (eta * cos_d + refracted)
    return float((abs(s) ** 2 + abs(p) ** 2) / 2)


def rounding(cos_d: float, n: float, k: float, eps: float) -> float:
    """How far rounding may carry F, to first order.

    Under the root w = √((n + ik)² - s²) three terms are rounded, so its square is off by δ = 4ε(|n + ik|² + 1) at
    most; then each part of w, taken from |w²| ± Re w², is off by min(√δ, δ/2·part). R_s and the quotient R_p/R_s
    follow with the slopes 4c/|w + c|² and 4cs²/|wc + s²|²; every other operation keeps its relative accuracy.
    """
    sin2 = (1 - cos_d) * (1 + cos_d)
    root = np.sqrt(complex(n, k) ** 2 - sin2)
    delta = 4 * eps * (n**2 + k**2 + 1)
    moved = sum(min(math.sqrt(delta), delta / (2 * part)) if part else math.sqrt(delta) for part in _parts(root))
    slope_s = 4 * cos_d / max(abs(root + cos_d), moved) ** 2
    slope_q = 4 * cos_d * sin2 / max(abs(root * cos_d + sin2), moved) ** 2
    return min(1.0, (slope_s + 0.5 * slope_q) * moved) + 16 * eps


def _parts(root: complex) -> tuple[float, float]:
    return abs(root.real), abs(root.imag)


@given(cosines, refractive, extinctions)
def test_conductor_equals_complex_arithmetic(cos_d, n, k):
    if (n, k) == (1, 0):
        return  # the amplitudes are 0/0 at c = 0; see below
    found = fresnel.conductor(*float64(cos_d, n, k)).item()
    assert found == pytest.approx(amplitudes(cos_d, n, k), abs=rounding(cos_d, n, k, EPS64))


@given(cosines, refractive, extinctions)
def test_float32_loses_no_more_than_its_rounding(cos_d, n, k):
    inputs = torch.tensor([cos_d, n, k], dtype=torch.float32)
    if tuple(inputs[1:].tolist()) == (1, 0):
        return
    found = fresnel.conductor(*inputs).item()
    assert found == pytest.approx(amplitudes(*inputs.tolist()), abs=rounding(*inputs.tolist(), EPS32))


@pytest.mark.parametrize("metal", read_catalogue(), ids=lambda metal: metal.name)
def test_conductor_equals_mitsuba(metal):
    mi = mitsuba("scalar_rgb")
    for n, k in zip(metal.n, metal.k, strict=True):
        for cos_d in np.linspace(0.01, 1, 12):
            expected = mi.fresnel_conductor(cos_d, mi.Complex2f(n, k))
            found = fresnel.conductor(*float64(cos_d, n, k)).item()
            assert found == pytest.approx(expected, abs=rounding(cos_d, n, k, EPS32))


@given(refractive, extinctions)
@example(0.02, 0.0)
def test_conductor_at_normal_and_grazing_incidence(n, k):
    normal, grazing = (fresnel.conductor(*float64(cos_d, n, k)).item() for cos_d in (1, 0))
    tolerance = rounding(1, n, k, EPS64)
    assert normal == pytest.approx(((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), abs=tolerance)
    assert fresnel.normal_reflectance(*float64(n, k)).item() == pytest.approx(normal, abs=tolerance)
    assert grazing == pytest.approx(0 if (n, k) == (1, 0) else 1, abs=4 * EPS64)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("cos_d", COSINES)
def test_air_reflects_nothing(cos_d, dtype):
    air, none = torch.ones((), dtype=dtype), torch.zeros((), dtype=dtype)
    assert fresnel.conductor(air * cos_d, air, none).item() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@given(cosines, refractive, extinctions)
def test_conductor_reflects_between_nothing_and_everything(dtype, cos_d, n, k):
    found = fresnel.conductor(*torch.tensor([cos_d, n, k], dtype=dtype)).item()
    assert 0 <= found <= 1 + 4 * torch.finfo(dtype).eps


@given(cosines, st.floats(1.001, 20))
def test_dielectric_is_the_conductor_that_does_not_absorb(cos_d, ior):
    cos_d, ior = float64(cos_d, ior)
    expected = fresnel.conductor(cos_d, ior, torch.zeros_like(ior)).item()
    tolerance = rounding(cos_d.item(), ior.item(), 0, EPS64)
    assert fresnel.dielectric(cos_d, ior).item() == pytest.approx(expected, abs=tolerance)


@given(st.floats(0.01, 1.5), st.floats(1.01, 4))
def test_dielectric_equals_fresnels_sines_and_tangents(theta, ior):
    refracted = math.asin(math.sin(theta) / ior)  # Snell
    s = math.sin(theta - refracted) / math.sin(theta + refracted)
    p = math.tan(theta - refracted) / math.tan(theta + refracted)
    found = fresnel.dielectric(*float64(math.cos(theta), ior)).item()
    # the sines subtract angles that differ by 0.01 θ at least: 2 digits less
    assert found == pytest.approx((s**2 + p**2) / 2, rel=1e-11, abs=1e-14)


@pytest.mark.parametrize("ior", [1.33, 1.5, 2.42])
def test_brewsters_angle_reflects_only_s_polarised_light(ior):
    cos_b = 1 / math.sqrt(1 + ior**2)  # tan θ = η makes r_p = 0, so F = r_s²/2
    expected = 0.5 * ((ior**2 - 1) / (ior**2 + 1)) ** 2
    assert fresnel.dielectric(*float64(cos_b, ior)).item() == pytest.approx(expected, rel=1e-14)


@given(cosines, refractive, extinctions)
def test_lazanyi_is_schlick_with_the_normal_reflectance(cos_d, n, k):
    f0 = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    expected = f0 + (1 - f0) * (1 - cos_d) ** 5
    assert fresnel.lazanyi(*float64(cos_d, n, k)).item() == pytest.approx(expected, abs=16 * EPS64)
    assert fresnel.schlick(*float64(cos_d, f0)).item() == pytest.approx(expected, abs=16 * EPS64)


@given(st.floats(0, 1), st.floats(0, 1), st.floats(1.01, 3.7))
def test_dielectrics_reflect_more_at_grazing_angles(one, other, ior):
    """Up to η = 2 + √3 the second derivative at normal incidence is positive; above, F first falls."""
    steep, grazing = max(one, other), min(one, other)
    for function, material in ((fresnel.dielectric, ior), (fresnel.schlick, ((ior - 1) / (ior + 1)) ** 2)):
        low, high = (function(*float64(cos_d, material)).item() for cos_d in (steep, grazing))
        assert low <= high + 8 * EPS64


def test_high_indices_dip_before_they_rise():
    low, high = (fresnel.dielectric(*float64(cos_d, 6)).item() for cos_d in (0.7, 1))
    assert low < high - 1e-3


@given(refractive, st.floats(0, 19), st.floats(1e-3, 1))
def test_absorption_raises_the_normal_reflectance(n, k, more):
    low, high = (fresnel.normal_reflectance(*float64(n, value)) for value in (k, k + more))
    assert 0 <= low < high < 1


@given(st.floats(1e-6, 1 - 1e-6), st.floats(-1, 1))
def test_every_index_within_the_limits_has_one_extinction(r, share):
    limit = ((1 + math.sqrt(r)) / (1 - math.sqrt(r))) ** share
    n = torch.tensor(limit, dtype=torch.float64)
    k = fresnel.extinction(*float64(r), n)
    # both factors of k² are off by ε·m, which F0 sees divided by (n + 1)² + k² >= m
    assert fresnel.normal_reflectance(n, k).item() == pytest.approx(r, abs=64 * EPS64)


@given(st.floats(1e-6, 0.99), st.floats(1.01, 3))
def test_no_index_beyond_the_limits_has_an_extinction(r, factor):
    (limit,) = (fresnel.index_limit(value) for value in float64(r))
    assert fresnel.extinction(*float64(r), limit * factor) == 0
    assert fresnel.extinction(*float64(r), 1 / (limit * factor)) == 0


def gulbrandsen(r: float, g: float) -> tuple[float, float]:
    """n and k as the paper prints them, k² not factored."""
    root = math.sqrt(r)
    n = g * (1 - r) / (1 + r) + (1 - g) * (1 + root) / (1 - root)
    return n, math.sqrt(max(0.0, (r * (n + 1) ** 2 - (n - 1) ** 2) / (1 - r)))


@given(st.floats(0.01, 0.99), st.floats(0.01, 1))
def test_edge_tint_is_gulbrandsens(r, g):
    n, k = fresnel.from_edge_tint(*float64(r, g))
    # r(n+1)² - (n-1)² cancels to a hundredth at g = 0.01, and 1/(1-r) takes two more digits
    assert (n.item(), k.item()) == pytest.approx(gulbrandsen(r, g), rel=1e-10)


@given(st.floats(1e-6, 1 - 1e-6), st.floats(0, 1))
@example(0.5, 0.0)
@example(0.5, 1.0)
def test_edge_tint_comes_back(r, g):
    found = torch.stack(fresnel.edge_tint(*fresnel.from_edge_tint(*float64(r, g))))
    # F0 returns to within ε; n_max - n_min is about 2√r for small r, and n_max doubles its error per 1/(1-r)
    assert found[0].item() == pytest.approx(r, abs=64 * EPS64)
    assert found[1].item() == pytest.approx(g, abs=64 * EPS64 * (1 / (1 - r) + 1 / math.sqrt(r)))


@pytest.mark.parametrize("metal", read_catalogue(), ids=lambda metal: metal.name)
def test_real_metals_come_back_from_their_edge_tint(metal):
    n, k = float64(metal.n, metal.k)
    r, g = fresnel.edge_tint(n, k)
    found_n, found_k = fresnel.from_edge_tint(r, g)
    # n = n_max - g(n_max - n_min): n_max, up to 400, carries ε/(1-r) of itself
    lost = (16 * EPS64 * fresnel.index_limit(r) / (1 - r)).max().item()
    torch.testing.assert_close(found_n, n, atol=lost, rtol=0)
    torch.testing.assert_close(found_k, k, atol=lost * fresnel.index_limit(r).max().item(), rtol=0)


POINTS = {
    fresnel.schlick: [(0.3, 0.7, 0.95), (0.04, 0.5, 0.9)],
    fresnel.lazanyi: [(0.3, 0.7, 0.95), (0.2, 1.4, 6), (3.5, 0.1, 7)],
    fresnel.conductor: [(0.05, 0.5, 0.8, 0.95), (0.15, 1.4, 6, 0.6), (3.5, 0.1, 7, 0.02)],
    fresnel.dielectric: [(0.05, 0.5, 0.95), (1.05, 1.5, 6)],
    fresnel.extinction: [(0.2, 0.9, 0.5), (0.5, 1.1, 3)],
    fresnel.from_edge_tint: [(0.2, 0.9, 0.5), (0.3, 0.95, 0.7)],
    fresnel.edge_tint: [(0.2, 1.4, 6), (3.5, 0.1, 7)],
}


@pytest.mark.parametrize("function", POINTS, ids=lambda function: function.__name__)
def test_derivatives_meet_finite_differences(function):
    inputs = tuple(tensor.requires_grad_() for tensor in float64(*POINTS[function]))
    assert torch.autograd.gradcheck(function, inputs)


@pytest.mark.parametrize("n", [0.01, 0.6, 1.0, 20.0])
@pytest.mark.parametrize("k", [0.0, 1e-12, 3.0])
@pytest.mark.parametrize("cos_d", [0.0, 0.8, 1.0])  # 0.6² + 0.8² = 1: total reflection begins
def test_derivatives_are_finite_wherever_the_root_branches(cos_d, n, k):
    inputs = [tensor.requires_grad_() for tensor in float64(cos_d, n, k)]
    found = torch.autograd.grad(fresnel.conductor(*inputs), inputs)
    assert all(gradient.isfinite() for gradient in found)
