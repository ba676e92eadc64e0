"""The free vector: it reaches every metal, nothing else, and its derivatives hold."""

import math

import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.renderer.materials.catalogue import read_catalogue
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.optics import fresnel

EPS = 2.0**-52
LOGARITHMIC, LINEAR = WidthInterval(0.02, 1.0, logarithmic=True), WidthInterval(0.0, 0.8, logarithmic=False)


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def metal(n, k, roughness: float = 0.3) -> Metal:
    return Metal(float64(n), float64(k), Microfacet(float64(roughness)))


def thrice(low: float, high: float):
    return st.tuples(*[st.floats(low, high)] * 3)


@pytest.mark.parametrize("roughness", [LOGARITHMIC, LINEAR], ids=["logarithmic", "linear"])
@given(thrice(0.02, 10), thrice(0.01, 12), st.floats(0.03, 0.75))
@example((1.0, 1.0, 1.0), (0.01, 1.0, 12.0), 0.5)
def test_every_metal_comes_back(roughness, n, k, rough):
    coordinates, given_metal = MetalCoordinates(roughness), metal(n, k, rough)
    found = coordinates.material(coordinates.free(given_metal))
    # n is m^t, log m = 9 at most: ε/(1-F0) = 5e-13 of it. k goes with √(1-t), and 1-t falls to 1e-7 at n = 10,
    # k = 0.01, where ε of t is 2e-9 of it
    torch.testing.assert_close(found.n, given_metal.n, rtol=1e-10, atol=0)
    torch.testing.assert_close(found.k, given_metal.k, rtol=1e-8, atol=0)
    torch.testing.assert_close(found.f0, given_metal.f0, rtol=0, atol=1e-12)
    torch.testing.assert_close(found.width.value, given_metal.width.value, rtol=1e-12, atol=0)


@pytest.mark.parametrize("entry", read_catalogue(), ids=lambda entry: entry.name)
def test_real_metals_come_back(entry):
    coordinates, real = MetalCoordinates(LOGARITHMIC), metal(entry.n, entry.k)
    found = coordinates.material(coordinates.free(real))
    torch.testing.assert_close(found.n, real.n, rtol=1e-10, atol=0)
    torch.testing.assert_close(found.k, real.k, rtol=1e-10, atol=0)


free_numbers = st.one_of(st.floats(-30, 30), st.floats(-1e3, 1e3), st.sampled_from([0.0, 19.1, -19.1, 36.8, -745.2]))


@given(st.lists(free_numbers, min_size=7, max_size=7))
@example([0.0] * 7)
def test_every_free_vector_is_a_metal_with_derivatives(x):
    coordinates = MetalCoordinates(LOGARITHMIC)

    def quantities(free: torch.Tensor) -> torch.Tensor:
        found = coordinates.material(free)
        return torch.cat([found.n, found.k, found.f0, found.width.value[None]])

    n, k, f0, roughness = quantities(float64(x)).split([3, 3, 3, 1])
    assert ((n > 0) & n.isfinite()).all()
    assert ((k >= 0) & k.isfinite()).all()
    assert ((f0 >= 0) & (f0 < 1)).all(), f0
    assert 0.02 * (1 - 4 * EPS) <= roughness <= 1 + 4 * EPS
    reflected = fresnel.conductor(float64([[0.0], [0.5], [1.0]]), n, k)
    assert ((reflected >= 0) & (reflected <= 1 + 4 * EPS)).all()
    assert torch.func.jacfwd(quantities)(float64(x)).isfinite().all()


@given(thrice(-6, 6), thrice(-3, 3), st.floats(-4, 4))
def test_what_the_docstring_prints(reflectivity, tint, rough):
    found = MetalCoordinates(LOGARITHMIC).material(float64([*reflectivity, *tint, rough]))
    for channel in range(3):
        f0 = 1 / (1 + math.exp(-reflectivity[channel]))
        limit = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))
        assert found.f0[channel].item() == pytest.approx(f0, abs=1e-12)
        assert found.n[channel].item() == pytest.approx(limit ** math.tanh(tint[channel]), rel=1e-11)
    share = 1 / (1 + math.exp(-rough))
    assert found.width.value.item() == pytest.approx(0.02 ** (1 - share), rel=1e-12)


@given(thrice(-4, 6), thrice(-2.5, 2.5), st.floats(-4, 4))
def test_derivatives_meet_finite_differences(reflectivity, tint, rough):
    coordinates = MetalCoordinates(LOGARITHMIC)

    def quantities(free: torch.Tensor) -> torch.Tensor:
        found = coordinates.material(free)
        return torch.cat([found.n, found.k, found.width.value[None]]).log()

    # n and k span decades: of their logarithms, with m up to 1600, gradcheck's relative 1e-3 is ample
    assert torch.autograd.gradcheck(quantities, float64([*reflectivity, *tint, rough]).requires_grad_())


def test_a_fixed_tint_is_no_unknown():
    free = MetalCoordinates(LOGARITHMIC)
    whole = free.free(metal((0.15, 0.43, 1.43), (3.6, 2.3, 1.85)))
    held = MetalCoordinates(LOGARITHMIC, tint=whole[3:6])
    assert (free.size, held.size) == (7, 4)
    x = held.free(free.material(whole))
    torch.testing.assert_close(x, whole[[0, 1, 2, 6]])
    torch.testing.assert_close(held.material(x).n, free.material(whole).n)
    torch.testing.assert_close(held.material(x).k, free.material(whole).k)


@pytest.mark.parametrize("interval", [LOGARITHMIC, LINEAR], ids=["logarithmic", "linear"])
@given(st.floats(-12, 12))
def test_an_interval_is_the_image_of_the_line(interval, free):
    value = interval.value(float64(free))
    assert interval.low < value < interval.high
    # beyond |x| = 12 the sigmoid is within 6e-6 of its end: ε is magnified by 1/6e-6 and the ends' share of 50
    assert interval.free(value).item() == pytest.approx(free, abs=1e-8)
    assert interval.value(float64(free + 0.1)) > value
