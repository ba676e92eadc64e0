"""Microfacets against quadrature and Mitsuba; the 49 taps against plain loops."""

import math

import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from fit_material.renderer.mitsuba.conversion import mitsuba
from fit_material.shaders.optics import blur, microfacets
from tests.support.quadrature import albedo, masking, normals

DISTRIBUTIONS = ["ggx", "beckmann"]
ALPHAS = [0.01, 0.05, 0.3, 1.0]
EPS32 = 2.0**-23


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def mitsuba_lobe(distribution: str, alpha: float):
    mi = mitsuba("scalar_rgb")
    kind = {"ggx": mi.MicrofacetType.GGX, "beckmann": mi.MicrofacetType.Beckmann}[distribution]
    return mi, mi.MicrofacetDistribution(kind, alpha, True)


def direction(mi, theta: float, phi: float):
    return mi.Vector3f(math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta))


@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_normals_project_onto_the_whole_surface(distribution, alpha):
    """∫ D cos θ dω = 1; the substitution s = tan θ/α has cos θ dω = 2π α² s/(1 + α²s²)² ds."""
    x, weight = np.polynomial.legendre.leggauss(200)
    s = (1 + x) / (1 - x)
    cos_h = 1 / np.sqrt(1 + (alpha * s) ** 2)
    density = microfacets.distribution_of_normals(float64(cos_h), float64(alpha), distribution).numpy()
    jacobian = 2 * math.pi * alpha**2 * s * cos_h**4 * 2 / (1 - x) ** 2
    # 1 - cos θ loses ε/(αs)² of itself at α = 0.01: twelve digits are left where D is not negligible
    assert (density * jacobian * weight).sum() == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_density_and_masking_are_mitsubas(distribution, alpha):
    mi, expected = mitsuba_lobe(distribution, alpha)
    for slope in (0.0, 0.1, 0.5, 1.0, 2.0, 3.0):
        theta = math.atan(alpha * slope)
        m, cos_h = direction(mi, theta, 1.0), float64(math.cos(theta))
        found = microfacets.distribution_of_normals(cos_h, float64(alpha), distribution).item()
        # Mitsuba's sin² keeps float32's relative accuracy, which the exponent s² multiplies
        assert found == pytest.approx(expected.eval(m), rel=(16 + 4 * slope**2) * EPS32)
    for cos in (1.0, 0.99, 0.6, 0.2, 0.05, 0.004):
        v = direction(mi, math.acos(cos), 2.0)
        found = microfacets.smith_g1(float64(cos), float64(alpha), distribution).item()
        up = mi.Vector3f(0, 0, 1)
        # acos and cos of Mitsuba's float32 vector leave ε/cos of a grazing direction
        assert found == pytest.approx(expected.smith_g1(v, up), rel=16 * EPS32 / cos)


@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_visible_normals_have_mitsubas_density(distribution, alpha):
    mi, expected = mitsuba_lobe(distribution, alpha)
    width = float64(alpha)
    for theta in (0.0, 0.7, 1.4):
        for slope, azimuth in ((0.0, 0.0), (0.5, 0.3), (1.0, 2.0)):
            m = direction(mi, math.atan(alpha * slope), azimuth)
            v = direction(mi, theta, 0)
            cos_d = sum(a * b for a, b in zip(m, v, strict=True))
            cos_v, cos_h = float64(math.cos(theta)), float64(math.cos(math.atan(alpha * slope)))
            found = (
                microfacets.smith_g1(cos_v, width, distribution)
                * microfacets.distribution_of_normals(cos_h, width, distribution)
                * max(0, cos_d)
                / cos_v
            ).item()
            assert found == pytest.approx(expected.pdf(v, m), rel=64 * EPS32 / math.cos(theta))


@given(st.floats(1e-3, 20))
def test_beckmanns_rational_masking_is_as_near_as_it_says(a):
    tangent = 1 / a  # at α = 1
    found = microfacets.smith_g1(float64(1 / math.sqrt(1 + tangent**2)), float64(1.0), "beckmann").item()
    exact = 2 / (1 + math.erf(a) + math.exp(-(a**2)) / (a * math.sqrt(math.pi)))  # [Walter 2007, eq. 27]
    assert found == pytest.approx(exact, rel=0.0035)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@given(st.floats(-1, 1), st.floats(0.001, 1))
def test_masking_is_a_share_and_finite_with_its_derivatives(distribution, cos, alpha):
    cos, alpha = float64(cos).requires_grad_(), float64(alpha).requires_grad_()
    found = microfacets.smith_g1(cos, alpha, distribution)
    # the rational form of Beckmann's meets 1 at a = 1.6 with an excess of 1e-4
    assert 0 <= found <= 1 + 2e-4
    assert found == 0 or cos > 0
    assert all(gradient.isfinite() for gradient in torch.autograd.grad(found, (cos, alpha)))


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize(
    "function", [microfacets.distribution_of_normals, microfacets.smith_g1], ids=lambda f: f.__name__
)
def test_derivatives_meet_finite_differences(function, distribution):
    cos, alpha = float64([0.1, 0.6, 0.97]).requires_grad_(), float64(0.3).requires_grad_()
    assert torch.autograd.gradcheck(lambda c, a: function(c, a, distribution), (cos, alpha))


@pytest.mark.parametrize(("theta", "alpha"), [(0.0, 0.3), (0.6, 0.02), (1.0, 0.5), (1.45, 0.2), (1.5, 1.0)])
def test_visible_normals_fall_with_their_density(theta, alpha):
    """χ² on cells of tan θ_h/α = tan ψ and azimuth, where D cos θ dω = sin 2ψ dψ dφ/2π."""
    count, rows, columns, fine = 200_000, 12, 12, 40
    u1, u2 = torch.rand(2, count, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    x, y, z = (c.numpy() for c in microfacets.sample_visible_normals(float64(math.cos(theta)), alpha, u1, u2))
    np.testing.assert_allclose(x**2 + y**2 + z**2, 1, rtol=1e-12)
    psi = np.arctan2(np.hypot(x, y), alpha * z)
    edges = np.linspace(0, math.pi / 2, rows + 1), np.linspace(-math.pi, math.pi, columns + 1)
    observed, *_ = np.histogram2d(psi, np.arctan2(y, x), edges)

    psi = (np.arange(rows * fine)[:, None] + 0.5) / (rows * fine) * math.pi / 2
    phi = (np.arange(columns * fine) + 0.5) / (columns * fine) * 2 * math.pi - math.pi
    towards = math.cos(theta) + math.sin(theta) * alpha * np.tan(psi) * np.cos(phi)  # v·h / cos θ_h
    share = masking(np.array(math.cos(theta)), alpha, "ggx") * np.maximum(0, towards) / math.cos(theta)
    share = share * np.sin(2 * psi) * (math.pi / 2) / (rows * columns * fine**2)
    expected = count * share.reshape(rows, fine, columns, fine).sum((1, 3))
    assert expected.sum() == pytest.approx(count, rel=1e-3)
    full = expected > 10
    chi2 = ((observed - expected)[full] ** 2 / expected[full]).sum()
    freedom = full.sum() - 1
    assert (chi2 - freedom) / math.sqrt(2 * freedom) < 5
    assert observed[~full].sum() <= expected[~full].sum() + 5 * math.sqrt(expected[~full].sum()) + 5


@given(st.floats(1e-4, 1), st.floats(1e-3, 1), st.floats(0, 1 - 2**-24), st.floats(0, 1 - 2**-24))
def test_visible_normals_are_unit_and_seen(cos_v, alpha, u1, u2):
    x, y, z = microfacets.sample_visible_normals(*torch.tensor([cos_v]), alpha, *torch.tensor([u1, u2]))
    assert x**2 + y**2 + z**2 == pytest.approx(1, abs=8 * EPS32)
    assert z >= 0
    # a normal that is just seen has v·h = 0; stretching back multiplies the rounding by 1/α at most
    assert math.sqrt(1 - cos_v**2) * x + cos_v * z >= -8 * EPS32 / alpha


def weight(cos_v, cos_l, cos_h, alpha: float, distribution: str) -> torch.Tensor:
    """What a direction counts that `sample_visible_normals` drew: reflected light over density."""
    density = microfacets.visible_normal_density(cos_v, cos_h, alpha)
    return microfacets.reflected(cos_v, cos_l, cos_h, alpha, distribution) / density


def sampled(cos_v: float, alpha: float, distribution: str, side: int = 400):
    """Weights of all points of a regular grid."""
    u = (torch.arange(side, dtype=torch.float64) + 0.5) / side
    u1, u2 = torch.meshgrid(u, u, indexing="ij")
    x, _, z = microfacets.sample_visible_normals(float64(cos_v), alpha, u1, u2)
    cos_d = math.sqrt(1 - cos_v**2) * x + cos_v * z
    return weight(float64(cos_v), 2 * cos_d * z - cos_v, z, alpha, distribution)


@pytest.mark.parametrize("alpha", [0.01, 0.2, 0.6, 1.0])
@pytest.mark.parametrize("cos_v", [1.0, 0.7, 0.25, 0.05])
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_white_furnace_loses_only_what_is_shadowed(distribution, cos_v, alpha):
    found = sampled(cos_v, alpha, distribution)
    # midpoints of 400² cells; across the horizon, where G1(l) bends, a cell in 400 errs by a cell's change at most
    assert found.mean().item() == pytest.approx(albedo(cos_v, alpha, distribution), abs=1 / 400**1.25)
    assert found.mean() <= 1 + 1e-4
    assert found.min() >= 0


@given(st.floats(1e-3, 1), st.floats(-1, 1), st.floats(1e-3, 1), st.floats(0.001, 1))
@example(1.0, 1.0, 1.0, 0.48845914395882467)  # which float32 does not hold
def test_weights_are_bounded(cos_v, cos_l, cos_h, alpha):
    cosines = float64(cos_v), float64(cos_l), float64(cos_h)
    assert weight(*cosines, alpha, "ggx") <= 1 + 8 * torch.finfo(torch.float64).eps
    masked = [microfacets.smith_g1(cosines[0], float64(alpha), name).item() for name in ("beckmann", "ggx")]
    # (1 + s²)² exp(-s²) is greatest at s = 1
    assert weight(*cosines, alpha, "beckmann") <= (1 + 1e-3) * 4 / math.e * masked[0] / masked[1]


def test_quadrature_itself_integrates_to_one():
    for distribution in DISTRIBUTIONS:
        assert (normals(0.3, distribution)[2].sum() * 240) == pytest.approx(1, abs=1e-12)


def test_tap_weights_are_a_gaussian_of_half_the_radius():
    found = blur.tap_weights().numpy()
    expected = [math.exp(-0.5 * (i / 1.5) ** 2) for i in range(-3, 4)]
    np.testing.assert_allclose(found, np.array(expected) / sum(expected), rtol=1e-14)
    # σ = ½ in units of ρ, cut off at 3.5 taps = 7/3 σ: variance σ²(1 - 2aφ(a)/(2Φ(a) - 1))
    a = 7 / 3
    cut = 2 * a * math.exp(-(a**2) / 2) / math.sqrt(2 * math.pi) / math.erf(a / math.sqrt(2))
    spread = (found * (np.arange(-3, 4) / 3) ** 2).sum()
    # seven midpoints instead of the integral over steps of ⅔ σ: 1 % of the variance
    assert spread == pytest.approx(0.25 * (1 - cut), rel=0.01)


unit_vectors = (
    st.tuples(*[st.floats(-1, 1)] * 3)
    .filter(lambda v: math.hypot(*v) > 0.1)
    .map(lambda v: torch.nn.functional.normalize(float64(v), dim=0))
)


@given(unit_vectors)
def test_tap_axes_are_a_frame_with_a_horizontal_side(r):
    k_h, k_v = blur.tap_axes(r)
    frame = torch.stack([k_h, k_v, r])
    torch.testing.assert_close(frame @ frame.T, torch.eye(3).double(), atol=1e-12, rtol=0)
    torch.testing.assert_close(torch.linalg.cross(k_h, r), k_v)
    assert k_h[1] == 0


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_tap_axes_where_there_is_no_horizontal(up):
    k_h, k_v = blur.tap_axes(float64([0.0, up, 0.0]))
    assert k_h.tolist() == [1, 0, 0]
    assert k_v.tolist() == [0, 0, up]  # x × ±y = ±z


@given(unit_vectors, st.floats(0, 2))
def test_taps_are_the_models(r, rho):
    found = blur.tap_directions(r, float64(rho))
    k_h, k_v = blur.tap_axes(r)
    for i in range(-3, 4):
        for j in range(-3, 4):
            expected = r + i / 3 * rho * k_h + j / 3 * rho * k_v
            torch.testing.assert_close(found[i + 3, j + 3], expected / expected.norm(), atol=1e-12, rtol=0)


def test_radii_broadcast_over_directions():
    r = torch.nn.functional.normalize(torch.randn(5, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    rho = torch.linspace(0, 1, 5)
    each = torch.stack([blur.tap_directions(one, radius) for one, radius in zip(r, rho, strict=True)])
    torch.testing.assert_close(blur.tap_directions(r, rho), each)
    torch.testing.assert_close(blur.tap_directions(r, torch.tensor(0.0)), r[:, None, None].expand(5, 7, 7, 3))
