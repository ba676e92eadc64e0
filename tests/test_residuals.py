"""The robust loss in closed form, weights, and a whole residual vector against plain arithmetic."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fitter.parameters import TINT_WIDTH, GlossyCoordinates, Interval, MatteCoordinates, MetalCoordinates
from fitter.pixel_model import BlurredByTable, Body, DirectLight, ExactPixels, PixelModel, ViewerPixels
from fitter.residuals import ROBUST_AT, Residuals, pseudo_huber, relative_weight, scatter
from renderer.transport import LightTable
from shaders import fresnel
from shaders.shade import DirectionalLight, Points

EPS = 2.0**-52


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


@given(st.floats(-1e8, 1e8), st.floats(1e-3, 1e3))
def test_half_its_square_is_the_pseudo_huber_loss(r, threshold):
    found = pseudo_huber(float64(r), threshold).item()
    # t²(√(1 + q²) - 1) cancels for small q; t² q²/(√(1 + q²) + 1) is the same number
    q = r / threshold
    assert 0.5 * found**2 == pytest.approx(threshold**2 * q**2 / (math.sqrt(1 + q**2) + 1), rel=16 * EPS)
    assert math.copysign(1, found) == math.copysign(1, r) or found == 0


@given(st.floats(1e-9, 1e-3), st.floats(0.1, 10))
def test_small_differences_count_by_their_square_and_large_ones_by_their_size(share, threshold):
    small, large = share * threshold, threshold / share
    # ψ² = r²(1 - q²/4 + …), and for large r ψ² = 2t|r|(1 - 1/q + …)
    assert pseudo_huber(float64(small), threshold).item() == pytest.approx(small, rel=share**2 / 8 + 8 * EPS)
    grown = pseudo_huber(float64(large), threshold).item() ** 2
    assert grown == pytest.approx(2 * threshold * large, rel=share + 8 * EPS)


@pytest.mark.parametrize("r", [-30.0, -1.0, 0.0, 0.2, 50.0])
def test_derivatives_meet_finite_differences(r):
    assert torch.autograd.gradcheck(lambda value: pseudo_huber(value, 3.0), float64(r).requires_grad_())
    if r == 0:
        assert torch.func.grad(lambda value: pseudo_huber(value, 3.0))(float64(0.0)) == 1


def test_dark_pixels_weigh_no_more_than_the_floor_allows():
    radiance = float64([[0.0, 1.0, 10.0], [1.0, 2.0, 20.0], [100.0, 3.0, 0.01]])
    # medians 1, 2, 10; a twentieth of each is the least radiance that is divided by
    expected = 1 / float64([[0.05, 1.0, 10.0], [1.0, 2.0, 20.0], [100.0, 3.0, 0.5]])
    torch.testing.assert_close(relative_weight(radiance), expected)


def test_black_photographs_have_finite_weights():
    weight = relative_weight(torch.zeros(5, 3, dtype=torch.float64))
    assert weight.isfinite().all()
    assert (weight > 0).all()


def test_scatter_is_the_standard_deviation_and_ignores_outliers():
    r = 3 * torch.randn(100_000, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    # the median absolute deviation of N normal numbers has a relative error of 1.17/√N
    assert scatter(r) == pytest.approx(3, rel=5 * 1.17 / math.sqrt(1e5))
    r[:1000] = 1e9  # one in a hundred moves the median by 1 % of a rank: 0.013 of its value
    assert scatter(r) == pytest.approx(3, rel=0.04)


SPAN = Interval(0.1, 0.8, logarithmic=True)
METAL = MetalCoordinates(SPAN)
X = [1.0, 0.3, 2.0, -0.5, 0.1, -1.0, 0.4]


def random(*shape: int, seed: int = 3) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def exact_pixels() -> ExactPixels:
    """Five pixels of three rays, four levels of roughness, degree 6, a body, and a light."""
    light = DirectLight(*(0.1 + 0.8 * random(5, 3, seed=seed) for seed in range(4)), float64([2.0, 1.0, 0.5]))
    bare = ExactPixels(None, None, Body(random(5, 6, 3), random(5, 6)), (light,), "ggx")
    return bare.under(LightTable(random(2, 4, 5, 6, 3).float(), 0.1, 0.8, "log"))


def viewer_pixels() -> ViewerPixels:
    normal, view = (torch.nn.functional.normalize(random(5, 3, seed=seed), dim=-1) for seed in (1, 2))
    source = DirectionalLight(float64([0.0, 0.6, 0.8]), float64([2.0, 1.0, 0.5]))
    light = BlurredByTable(None, None, random(9, 3) / 9, (source,))
    return ViewerPixels(Points(normal, view), light).under(LightTable(random(2, 4, 5, 1, 3).float(), 0.1, 0.8, "log"))


def test_the_residual_vector_is_what_it_says():
    """Barycentric interpolation in log α and numpy's Chebyshev fit, written out per pixel."""
    x, whole = float64(X), exact_pixels()
    model = ExactPixels(whole.table, whole.light, None, (), "ggx")
    metal = METAL.material(x)
    photograph, weight = random(5, 3, seed=4) + 0.5, random(5, 3, seed=5) + 0.5
    threshold = 2.0
    residuals = Residuals(model, METAL, photograph, weight, threshold / ROBUST_AT)

    node = -np.cos(np.pi * np.arange(4) / 3)
    log_alpha = 2 * math.log(metal.roughness.item() / 0.1) / math.log(8) - 1
    level = [np.prod([(log_alpha - b) / (a - b) for b in node if b != a]) for a in node]
    cos_d = (1 - np.cos(np.pi * np.arange(6) / 5)) / 2
    exact = fresnel.conductor
    curve = np.array([[exact(float64(c), n, k).item() for n, k in zip(metal.n, metal.k, strict=True)] for c in cos_d])
    f = np.polynomial.chebyshev.chebfit(2 * cos_d - 1, curve, 5)
    image = np.einsum("a,apbc,bc->pc", level, model.table.light.double().mean(0).numpy(), f)
    difference = (image - photograph.numpy()) * weight.numpy()
    np.testing.assert_allclose(residuals.weighted(x), difference, atol=1e-12)
    robust = np.sign(difference) * np.sqrt(2 * 4 * (np.sqrt(1 + (difference / 2) ** 2) - 1))
    np.testing.assert_allclose(residuals(x)[:-3].reshape(5, 3), robust, atol=1e-7)  # √ of a cancellation near 0
    prior = x[3:6].numpy() / TINT_WIDTH * threshold / ROBUST_AT
    np.testing.assert_allclose(residuals(x)[-3:], prior, rtol=1e-12)


def test_a_model_that_meets_the_photograph_leaves_nothing():
    model, x = exact_pixels(), float64(X)
    photograph = model.radiance(METAL.material(x))
    residuals = Residuals(model, METAL, photograph, relative_weight(photograph), 3.0)
    assert residuals(x)[:-3].abs().max() == 0
    assert residuals(x + 0.1)[:-3].abs().max() > 1e-3


@pytest.mark.parametrize("model", [exact_pixels(), viewer_pixels()], ids=["exact", "viewer"])
@pytest.mark.parametrize("coordinates", [METAL, GlossyCoordinates(SPAN, channels=1), MatteCoordinates(1)])
def test_the_jacobian_meets_finite_differences(model: PixelModel, coordinates):
    photograph = random(5, 3, seed=4)
    residuals = Residuals(model, coordinates, photograph, relative_weight(photograph), 3.0)
    x = float64(X)[-coordinates.size :]
    assert torch.autograd.gradcheck(residuals, x.clone().requires_grad_())
    torch.testing.assert_close(torch.func.jacfwd(residuals)(x), torch.func.jacrev(residuals)(x))


def test_lazanyi_cannot_see_the_tint_and_the_conductor_can():
    """At equal F0 Lázányi's picture stays the same, whatever n [MODEL.md 1]."""
    x, moved = float64(X), float64([1.0, 0.3, 2.0, 0.3, -0.6, -0.2, 0.4])
    of_viewer, exact = (
        [model.radiance(METAL.material(at)) for at in (x, moved)] for model in (viewer_pixels(), exact_pixels())
    )
    torch.testing.assert_close(*of_viewer, atol=1e-12, rtol=1e-12)
    assert (exact[0] - exact[1]).abs().max() > 1e-3
