"""The noise at each pixel: weights in closed form, covariances against the noise that was drawn."""

import math

import pytest
import torch

from fit_material.fitter.least_squares.noise import (
    even_whitening,
    local_whitening,
    neighbours_of,
    relative_weight,
    scatter,
)
from tests.fitter.estimation.test_coarse_to_fine import surface_of


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def drawn(*shape: int, seed: int = 1) -> torch.Tensor:
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


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
    r = 3 * drawn(100_000)
    # the median absolute deviation of N normal numbers has a relative error of 1.17/√N
    assert scatter(r) == pytest.approx(3, rel=5 * 1.17 / math.sqrt(1e5))
    r[:1000] = 1e9  # one in a hundred moves the median by 1 % of a rank: 0.013 of its value
    assert scatter(r) == pytest.approx(3, rel=0.04)


def test_even_whitening_divides_each_channel_by_its_noise():
    weight = float64([[1.0, 2.0, 4.0]])
    found = torch.einsum("prc,pc->pr", even_whitening(weight, 0.1), float64([[1.0, 1.0, 1.0]]))
    torch.testing.assert_close(found, float64([[10.0, 20.0, 40.0]]))


def test_neighbours_see_the_surface_alike_and_are_not_the_pixel_itself():
    surface = surface_of(48)[:, 0]
    found = neighbours_of(surface, 8)
    assert found.shape == (len(surface.hit), 8)
    assert (found != torch.arange(len(found))[:, None]).all()
    # a pixel of 48 across the ball is 0.05 of its radius; near the rim normals turn faster than places move
    near = (surface.normal[found] - surface.normal[:, None]).norm(dim=-1)
    assert near.median() < 0.2
    assert (surface.view[found] - surface.view[:, None]).norm(dim=-1).max() < 0.3  # of the same photograph


def test_a_lone_pixel_is_its_own_neighbour():
    surface = surface_of(48)[:1, 0]
    assert neighbours_of(surface).tolist() == [[0]]


def test_whitened_noise_is_white():
    """Noise of a known covariance, relative to a picture that varies tenfold, and four times as strong in one half of
    the pixels. An estimate from 32 neighbours inflates the mean of rᵀC⁻¹r from 3 to 3 · 32/(32 - 4) [inverse Wishart];
    the chance of 5000 pixels is 3 %, and brightness that differs among neighbours may add as much."""
    surface = surface_of(96)[:, 0]
    count = len(surface.hit)
    picture = (1 + 9 * surface.n_dot_v)[:, None] * float64([1.0, 2.0, 0.5])
    mixing = float64([[1.0, 0.0, 0.0], [0.98, 0.1, 0.0], [0.9, 0.2, 0.2]])
    strength = torch.where(surface.normal[:, 0] > 0, 0.04, 0.01).double()[:, None]
    noise = drawn(count, 3) @ mixing.T * strength * picture
    whitening = local_whitening(noise, picture, neighbours_of(surface), 1e-6)
    white = torch.einsum("prc,pc->pr", whitening, noise)
    inner = surface.normal[:, 0].abs() > 0.3
    covariance = white[inner].T @ white[inner] / inner.sum()
    assert covariance.trace().item() / 3 == pytest.approx(32 / 28, abs=0.06)
    assert (covariance - covariance.diag().diag()).abs().max() < 0.06


def test_a_pixels_own_noise_does_not_change_its_weight():
    surface = surface_of(24)[:, 0]
    noise, picture = 0.1 * drawn(len(surface.hit), 3), torch.ones(len(surface.hit), 3).double()
    neighbours = neighbours_of(surface)
    before = local_whitening(noise, picture, neighbours, 1e-6)
    noise[5] += 1e3
    after = local_whitening(noise, picture, neighbours, 1e-6)
    torch.testing.assert_close(after[5], before[5], rtol=0, atol=0)


def test_one_outlier_hardly_changes_its_neighbours_weights():
    """Cut at 10 median lengths, one of 32 adds at most 100/32 of the median's square to their covariance."""
    surface = surface_of(24)[:, 0]
    noise, picture = 0.1 * drawn(len(surface.hit), 3), torch.ones(len(surface.hit), 3).double()
    neighbours = neighbours_of(surface)
    before = local_whitening(noise, picture, neighbours, 1e-6)
    noise[5] = 1e6
    after = local_whitening(noise, picture, neighbours, 1e-6)
    for pixel in (neighbours == 5).any(1).nonzero()[:, 0].tolist():
        shrunk = torch.linalg.svdvals(after[pixel]).min() / torch.linalg.svdvals(before[pixel]).min()
        assert shrunk > 0.3


def test_noiseless_photographs_have_finite_weights():
    surface = surface_of(24)[:, 0]
    nothing = torch.zeros(len(surface.hit), 3).double()
    found = local_whitening(nothing, 1 + nothing, neighbours_of(surface), 1e-6)
    torch.testing.assert_close(found, 1e6 * torch.eye(3).double().expand_as(found))


@pytest.mark.parametrize("size", [1.0, 1e4, 1e8])
def test_differences_of_one_rank_are_whitened(size):
    """A grey error many times the picture: the covariance has one eigenvalue and rounding. Along it the whitening makes
    the variance 1; the share of rounding, 3e-13 against 1, tells it to 1e-6."""
    generator = torch.Generator().manual_seed(3)
    shape = torch.tensor([0.3, 0.6, 0.5], dtype=torch.float64)
    difference = size * torch.randn(200, 1, generator=generator, dtype=torch.float64) * shape
    picture, neighbours = torch.ones_like(difference), torch.randint(200, (200, 32), generator=generator)
    found = local_whitening(difference, picture, neighbours, 1e-6)
    assert found.isfinite().all()
    cut = (difference[neighbours].norm(dim=-1)).square().mean(1).sqrt()  # no outlier among normal numbers
    whitened = torch.einsum("prc,c->pr", found, shape / shape.norm()).norm(dim=-1) * cut
    torch.testing.assert_close(whitened, torch.ones_like(whitened), rtol=1e-3, atol=0)
