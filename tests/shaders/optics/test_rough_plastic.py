"""Rough plastic's diffuse part against Mitsuba's `roughplastic` and `plastic`, quadrature and energy."""

import functools
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fit_material.renderer.mitsuba.conversion import mitsuba
from fit_material.shaders.optics import fresnel, microfacets, rough_plastic
from tests.support.quadrature import masking, normals

DISTRIBUTIONS = ["ggx", "beckmann"]
ALPHAS = [0.01, 0.05, 0.2, 0.5, 1.0]
ETAS = [1.2, 1.5, 1.9, 2.5]
COSINES = [(1.0, 1.0), (0.5, 0.8), (0.1, 0.3), (0.03, 0.9), (0.7, 0.02)]


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def value(bsdf, mi, cos_v: float, cos_l: float) -> float:
    """BSDF times cosine."""
    interaction = mi.SurfaceInteraction3f()
    interaction.wi = mi.Vector3f(math.sqrt(1 - cos_v**2), 0, cos_v)
    towards = mi.Vector3f(0, math.sqrt(1 - cos_l**2), cos_l)
    return bsdf.eval(mi.BSDFContext(), interaction, towards)[0]


def mitsubas(kind: str, eta: float, **further):
    mi = mitsuba("scalar_rgb")
    parts = {
        "diffuse_reflectance": {"type": "rgb", "value": 0.6},
        "specular_reflectance": {"type": "rgb", "value": 0.0},
    }
    bsdf = mi.load_dict({"type": kind, "int_ior": eta, "ext_ior": 1.0, **parts, **further})
    return functools.partial(value, bsdf, mi)


@pytest.mark.parametrize("eta", ETAS)
@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_body_is_mitsubas_roughplastic(distribution, alpha, eta):
    body = mitsubas("roughplastic", eta, alpha=alpha, distribution=distribution)
    table = torch.linspace(0, 1, 64, dtype=torch.float64)  # Mitsuba's, which it interpolates linearly
    t = rough_plastic.transmittance(table, float64(eta), float64(alpha), distribution).numpy()
    scale = 0.6 * rough_plastic.outcoupling(float64(eta), float64(alpha), distribution).item()
    found = [scale * np.prod(np.interp(pair, table, t)) * pair[1] / math.pi for pair in COSINES]
    ratio = np.array([body(*pair) for pair in COSINES]) / found
    # T alone, the ratio of two directions: Mitsuba's 32 × 32 points leave 8e-4, where T is least
    assert ratio / ratio[0] == pytest.approx(1, abs=2e-3)
    # 1 - R: our quadrature leaves 1e-3 (2e-3 for η = 2.5), and Mitsuba's as much; at α = 0.01 its 64 cosines miss the
    # kink of R(µ) at the critical angle
    coarse = {1.9: 5e-3, 2.5: 2.2e-2}.get(eta, 0) if alpha < 0.05 else 0
    assert ratio[0] == pytest.approx(1, abs=coarse + (1.5e-3 if eta <= 1.5 else 3e-3))


@pytest.mark.parametrize("eta", ETAS)
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_smooth_limit_is_mitsubas_plastic(distribution, eta):
    """`plastic` has the true mean of the internal reflectance, by a fit of 1 % [d'Eon 2011], which 1/(1-R) enlarges."""
    alpha, cos = float64(1e-3), float64([1.0, 0.6, 0.2])
    t = rough_plastic.transmittance(cos, float64(eta), alpha, distribution)
    # the facets' spread of α² changes F by α² F''/2 < 1e-4 from cos 0.2 on, the quadrature by as much
    torch.testing.assert_close(t, 1 - fresnel.dielectric(cos, float64(eta)), rtol=0, atol=2e-4)
    r = rough_plastic.diffuse_internal_reflectance(float64(eta), alpha, distribution).item()
    body = mitsubas("plastic", eta)
    for i, j in ((0, 0), (1, 2)):
        expected = 0.6 / (1 - r) / eta**2 * (t[i] * t[j] * cos[j]).item() / math.pi
        assert body(cos[i].item(), cos[j].item()) == pytest.approx(expected, rel=0.01 * r / (1 - r))


@pytest.mark.parametrize("eta", ETAS)
def test_smooth_internal_reflectance_is_the_integral_of_fresnels_equations(eta):
    """2 ∫ c F dc from inside, by the amplitudes of s and p light and 10⁶ midpoints."""
    c = (np.arange(10**6) + 0.5) / 10**6
    t = np.sqrt((1 - eta**2 * (1 - c**2)).astype(complex))
    s, p = (eta * c - t) / (eta * c + t), (c - eta * t) / (c + eta * t)
    expected = (c * (np.abs(s) ** 2 + np.abs(p) ** 2)).mean()
    found = rough_plastic.diffuse_internal_reflectance(float64(eta), float64(1e-3), "beckmann").item()
    assert 1 - found == pytest.approx(1 - expected, rel=2e-4)  # 16 nodes: 5e-5; α: 1e-3 of the last grazing 1e-3


def seen_from_inside(mu: float, eta: float, alpha: float, side: int = 256) -> float:
    """R(µ) of GGX, over the facets that are seen, by Gauss–Legendre in the numbers that they are sampled with."""
    x, weight = np.polynomial.legendre.leggauss(side)
    u1, u2 = (grid.flatten() for grid in torch.meshgrid(*[float64((x + 1) / 2)] * 2, indexing="ij"))
    h_x, _, h_z = (h.numpy() for h in microfacets.sample_visible_normals(float64(mu), alpha, u1, u2))
    cos_d = np.clip(math.sqrt(1 - mu**2) * h_x + mu * h_z, 0, 1)
    t = np.sqrt((1 - eta**2 * (1 - cos_d**2)).astype(complex))
    s, p = (eta * cos_d - t) / (eta * cos_d + t), (cos_d - eta * t) / (cos_d + eta * t)
    back = (np.abs(s) ** 2 + np.abs(p) ** 2) / 2
    back = back * masking(2 * cos_d * h_z - mu, alpha, "ggx")
    return float(weight @ back.reshape(side, side) @ weight / 4)


@pytest.mark.parametrize(("f0", "alpha"), [(0.04, 0.1), (0.06, 0.05), (0.03, 0.4), (0.08, 0.2)])
def test_internal_reflectance_is_the_mean_over_64_cosines(f0, alpha):
    """A fitted colour is off by as much as 1 - R: here nothing but the quadrature differs, and not by 5e-4."""
    eta = rough_plastic.ior(float64(f0))
    cosines = np.maximum(1e-6, np.linspace(0, 1, 64))
    expected = 2 * np.mean([mu * seen_from_inside(mu, eta.item(), alpha) for mu in cosines])
    found = rough_plastic.internal_reflectance(eta, float64(alpha), "ggx").item()
    assert 1 - found == pytest.approx(1 - expected, rel=2e-4)  # 1.2e-4 is left


def over_normals(mu: float, eta: float, alpha: float, distribution: str) -> tuple[float, float]:
    """T from outside, and R(µ) from inside, both by a quadrature over all normals."""
    cos_h, cos_phi, weight = normals(alpha, distribution)
    c = np.maximum(0, math.sqrt(1 - mu**2) * np.sqrt(1 - cos_h**2) * cos_phi + mu * cos_h)
    visible = weight * masking(np.array(mu), alpha, distribution) * c / (mu * cos_h)
    below = np.sqrt(1 - (1 - c**2) / eta**2)
    through = 1 - fresnel.dielectric(torch.from_numpy(c), float64(eta)).numpy()
    t = (visible * through * masking(cos_h * (below - c / eta) + mu / eta, alpha, distribution)).sum()
    above = np.sqrt(np.maximum(0, 1 - eta**2 * (1 - c**2)))  # beyond total reflection F is 1, as at grazing angles
    back = fresnel.dielectric(torch.from_numpy(above), float64(eta)).numpy()
    return float(t), float((visible * back * masking(2 * c * cos_h - mu, alpha, distribution)).sum())


@pytest.mark.parametrize("eta", [1.2, 1.5, 2.5])
@pytest.mark.parametrize("alpha", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_transmittance_and_reflectance_are_integrals_over_all_normals(distribution, alpha, eta):
    x, weight = np.polynomial.legendre.leggauss(24)
    mu = (x + 1) / 2
    t, r = np.transpose([over_normals(m, eta, alpha, distribution) for m in mu])
    found = rough_plastic.transmittance(float64(mu), float64(eta), float64(alpha), distribution).numpy()
    # relative to the visible area, which Beckmann's rational G1 (0.35 %) gives in the oracle and the weights' sum in T
    assert found == pytest.approx(t, abs=3e-4, rel=0 if distribution == "ggx" else 4e-3)
    mean = rough_plastic.diffuse_internal_reflectance(float64(eta), float64(alpha), distribution).item()
    # both meet the kinks of horizon and total reflection with some 5e-4 of R
    assert mean == pytest.approx((r * mu * weight).sum(), abs=1.5e-3)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize(("f0", "alpha"), [(0.04, 0.02), (0.04, 0.3), (0.2, 0.9)])
def test_derivatives(distribution, f0, alpha):
    mu = float64([0.0, 0.03, 0.4, 1.0])

    def everything(f0, alpha):
        eta = rough_plastic.ior(f0)
        inside = rough_plastic.outcoupling(eta, alpha, distribution)
        return torch.cat([rough_plastic.transmittance(mu, eta, alpha, distribution), inside[None]])

    inputs = (float64(f0).requires_grad_(), float64(alpha).requires_grad_())
    assert torch.autograd.gradcheck(everything, inputs, check_forward_ad=True)
    forward = torch.func.jacfwd(everything, argnums=(0, 1))(*(x.detach() for x in inputs))
    step = 1e-6
    slope = (everything(float64(f0), float64(alpha + step)) - everything(float64(f0), float64(alpha - step))) / (
        2 * step
    )
    torch.testing.assert_close(forward[1], slope, rtol=1e-5, atol=1e-7)
    assert forward[1].abs().min() > 0


@settings(max_examples=60)
@given(
    eta=st.floats(1.0, 4.0), alpha=st.floats(1e-3, 1.0), mu=st.floats(0, 1), distribution=st.sampled_from(DISTRIBUTIONS)
)
def test_no_light_is_made(eta, alpha, mu, distribution):
    eta, alpha = float64(eta), float64(alpha)
    t = rough_plastic.transmittance(float64(mu), eta, alpha, distribution).item()
    assert 0 <= t <= 1 + 1e-12  # rounding: the weights sum to one
    r = rough_plastic.diffuse_internal_reflectance(eta, alpha, distribution).item()
    assert -1e-3 <= r < 1  # the quadrature's own error where nothing is reflected, η = 1
    x, weight = np.polynomial.legendre.leggauss(40)
    cos = float64((x + 1) / 2)
    let_in = (rough_plastic.transmittance(cos, eta, alpha, distribution) * cos * float64(weight)).sum().item()
    # a white body in even light: what comes in goes out, or is lost between facets; 1 - R is good to 3e-3
    assert let_in * rough_plastic.outcoupling(eta, alpha, distribution).item() <= 1 + 3e-3


@given(f0=st.floats(1e-6, 0.9))
def test_index_and_reflectance_are_inverse(f0):
    assert rough_plastic.f0(rough_plastic.ior(float64(f0))).item() == pytest.approx(f0, rel=1e-12 / math.sqrt(f0))


def test_channels_broadcast():
    mu, eta = torch.linspace(0, 1, 5, dtype=torch.float64)[:, None], float64([1.3, 1.5, 1.8])
    found = rough_plastic.transmittance(mu, eta, float64(0.2), "ggx")
    assert found.shape == (5, 3)
    torch.testing.assert_close(found[:, 1], rough_plastic.transmittance(mu[:, 0], eta[1], float64(0.2), "ggx"))
