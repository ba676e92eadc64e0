"""The robust loss in closed form, weights, and a whole residual vector against plain arithmetic."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fit_material.fitter.forward.direct_light import DirectLight
from fit_material.fitter.forward.pixel_model import BlurredByTable, Body, ExactPixels, PixelModel, ViewerPixels
from fit_material.fitter.least_squares.noise import even_whitening, relative_weight
from fit_material.fitter.least_squares.residuals import ROBUST_AT, Residuals, huber
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.glossy import GlossyCoordinates
from fit_material.fitter.materials.matte import MatteCoordinates
from fit_material.fitter.materials.metal import TINT_WIDTH, MetalCoordinates
from fit_material.renderer.light_sampling.fresnel_basis import BEND
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.shaders.lights import DirectionalLight
from fit_material.shaders.materials.widths import Blur
from fit_material.shaders.optics import fresnel
from fit_material.shaders.shade import Points

EPS = 2.0**-52


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


vectors = arrays(np.float64, (4, 3), elements=st.floats(-1e8, 1e8))


@given(vectors, st.floats(1e-3, 1e3))
def test_half_its_square_is_hubers_loss_of_the_length(r, threshold):
    found = huber(float64(r), threshold)
    for vector, shortened in zip(r, found, strict=True):
        length = math.sqrt(sum(float(v) ** 2 for v in vector))
        loss = 0.5 * length**2 if length <= threshold else threshold * length - 0.5 * threshold**2
        assert 0.5 * float(shortened.square().sum()) == pytest.approx(loss, rel=64 * EPS, abs=1e-300)
        torch.testing.assert_close(
            shortened / shortened.norm().clamp_min(1e-300), float64(vector / max(length, 1e-300))
        )


@given(vectors)
def test_what_is_no_outlier_stays_as_it_is(r):
    small = float64(r) * 1e-9
    torch.testing.assert_close(huber(small, 6.0), small, rtol=4 * EPS, atol=0)


@pytest.mark.parametrize("r", [-30.0, -1.0, 0.0, 0.2, 50.0])
def test_derivatives_meet_finite_differences(r):
    at = float64([[r, 0.0, 0.3 * r]]).requires_grad_()
    assert torch.autograd.gradcheck(lambda value: huber(value, 3.0), at)
    assert torch.func.jacfwd(lambda value: huber(value, 3.0))(at.detach()).isfinite().all()


def test_the_robust_whitening_has_the_losss_slope():
    """Σ ψψ' of the loss against WᵀW r of the lessened whitening, at a vector with outliers in it."""
    model, x = exact_pixels(), float64(X)
    photograph = model.radiance(METAL.material(x)) + float64([0.0, 0.1, 3.0, -9.0, 40.0])[:, None]
    residuals = Residuals(model, METAL, photograph, torch.eye(3).double().expand(5, 3, 3))
    slope = torch.func.grad(lambda x: 0.5 * residuals.whitened(x).square().sum())(x)
    whitening = residuals.robust_whitening(x)
    jacobian, left = whitening @ residuals.slope(x), torch.einsum("prc,pc->pr", whitening, residuals.difference(x))
    torch.testing.assert_close(torch.einsum("prx,pr->x", jacobian, left), slope)


SPAN = WidthInterval(0.1, 0.8, logarithmic=True)
BLURRED = replace(SPAN, lobe=Blur)
METAL = MetalCoordinates(SPAN)
X = [1.0, 0.3, 2.0, -0.5, 0.1, -1.0, 0.4]


def random(*shape: int, seed: int = 3) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def exact_pixels() -> ExactPixels:
    """Five pixels of three rays, four levels of roughness, degree 6, a body, and a light."""
    light = DirectLight(
        *(0.1 + 0.8 * random(5, 3, seed=seed) for seed in range(4)),
        float64([[2.0, 1.0, 0.5]] * 5),
        random(5, 3, 3, seed=9),
    )
    bare = ExactPixels(None, None, Body(random(5, 6, 3), random(5, 6)), (light,), "ggx")
    return bare.under(LightTable(random(2, 4, 5, 6, 3).float(), 0.1, 0.8, "log"))


def viewer_pixels() -> ViewerPixels:
    normal, view = (torch.nn.functional.normalize(random(5, 3, seed=seed), dim=-1) for seed in (1, 2))
    source = DirectionalLight(float64([0.0, 0.6, 0.8]), float64([2.0, 1.0, 0.5]))
    light = BlurredByTable(None, None, random(9, 3) / 9, (source,))
    return ViewerPixels(Points(normal, view), light).under(
        LightTable(random(2, 4, 5, 1, 3).float(), 0.1, 0.8, "log", Blur)
    )


def test_the_residual_vector_is_what_it_says():
    """Barycentric interpolation in log α and numpy's Chebyshev fit in the bent cosine, written out per pixel."""
    x, whole = float64(X), exact_pixels()
    model = ExactPixels(whole.table, whole.light, None, (), "ggx")
    metal = METAL.material(x)
    photograph, whitening = random(5, 3, seed=4) + 0.5, 10 * (random(5, 3, 3, seed=5) - 0.3)
    residuals = Residuals(model, METAL, photograph, whitening)

    node = -np.cos(np.pi * np.arange(4) / 3)
    log_alpha = 2 * math.log(metal.width.value.item() / 0.1) / math.log(8) - 1
    level = [np.prod([(log_alpha - b) / (a - b) for b in node if b != a]) for a in node]
    position = (1 - np.cos(np.pi * np.arange(6) / 5)) / 2
    cos_d = BEND * position / (1 + BEND - position)
    exact = fresnel.conductor
    curve = np.array([[exact(float64(c), n, k).item() for n, k in zip(metal.n, metal.k, strict=True)] for c in cos_d])
    f = np.polynomial.chebyshev.chebfit(2 * position - 1, curve, 5)
    image = np.einsum("a,apbc,bc->pc", level, model.table.light.double().mean(0).numpy(), f)
    difference = np.einsum("prc,pc->pr", whitening.numpy(), image - photograph.numpy())
    length = np.sqrt((difference**2).sum(1, keepdims=True))
    assert (length > ROBUST_AT).any()
    assert (length < ROBUST_AT).any()
    loss = np.where(length > ROBUST_AT, 2 * ROBUST_AT * length - ROBUST_AT**2, length**2)
    np.testing.assert_allclose(residuals(x)[:-3].reshape(5, 3), difference * np.sqrt(loss) / length, atol=1e-10)
    np.testing.assert_allclose(residuals(x)[-3:], x[3:6].numpy() / TINT_WIDTH, rtol=1e-12)


def test_light_that_was_integrated_badly_weighs_by_its_variance():
    """One pixel's halves far apart, their mean still the photograph: 1/variance of the weight that others have, beyond
    the threshold of outliers, and none of it taken from pixels within."""
    x, model = float64(X), exact_pixels()
    apart = model.table.light.clone()
    apart[0, :, 2], apart[1, :, 2] = 1.9 * apart.mean(0)[:, 2], 0.1 * apart.mean(0)[:, 2]
    model = model.under(replace(model.table, light=apart))
    photograph = model.radiance(METAL.material(x))
    half = model.half(0).radiance(METAL.material(x))[2] - photograph[2]
    noise = float(half.norm()) / 60
    weight = torch.full((5, 3), 1.0).double()
    weight[[0, 1, 3, 4]] = 1e-3  # their halves differ as well, but by nothing that matters beside such noise
    whitening = even_whitening(weight, noise)
    found = Residuals(model, METAL, photograph, whitening).robust_whitening(x)
    torch.testing.assert_close(found[2], whitening[2] * ROBUST_AT / 60)
    assert torch.equal(found[[0, 1, 3, 4]], whitening[[0, 1, 3, 4]])


def test_a_model_that_meets_the_photograph_leaves_nothing():
    model, x = exact_pixels(), float64(X)
    photograph = model.radiance(METAL.material(x))
    residuals = Residuals(model, METAL, photograph, even_whitening(relative_weight(photograph), 3.0))
    assert residuals(x)[:-3].abs().max() == 0
    assert residuals(x + 0.1)[:-3].abs().max() > 1e-3


@pytest.mark.parametrize("model", [exact_pixels(), viewer_pixels()], ids=["exact", "viewer"])
@pytest.mark.parametrize("coordinates", [METAL, GlossyCoordinates(SPAN, channels=1), MatteCoordinates(1)])
def test_the_jacobian_meets_finite_differences(model: PixelModel, coordinates):
    photograph = random(5, 3, seed=4)
    if isinstance(model, ViewerPixels) and coordinates.width is not None:
        coordinates = replace(coordinates, width=BLURRED)
    residuals = Residuals(model, coordinates, photograph, even_whitening(relative_weight(photograph), 0.1))
    x = float64(X)[-coordinates.size :]
    assert torch.autograd.gradcheck(residuals, x.clone().requires_grad_())
    torch.testing.assert_close(torch.func.jacfwd(residuals)(x), torch.func.jacrev(residuals)(x))
    torch.testing.assert_close(residuals.slope(x), torch.func.jacfwd(residuals.difference)(x))


def test_lazanyi_cannot_see_the_tint_and_the_conductor_can():
    """At equal F0 Lázányi's picture stays the same, whatever n [MODEL.md 1]."""
    x, moved = float64(X), float64([1.0, 0.3, 2.0, 0.3, -0.6, -0.2, 0.4])
    of_viewer, exact = (
        [model.radiance(MetalCoordinates(span).material(at)) for at in (x, moved)]
        for model, span in ((viewer_pixels(), BLURRED), (exact_pixels(), SPAN))
    )
    torch.testing.assert_close(*of_viewer, atol=1e-12, rtol=1e-12)
    assert (exact[0] - exact[1]).abs().max() > 1e-3
