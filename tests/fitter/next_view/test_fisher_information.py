"""Fisher information of pictures: closed forms, and what holds for any information."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.materials.registry import FITTABLE
from fit_material.fitter.next_view.fisher_information import VAGUE, ViewInformation, covariance, foreseen_noise, told_by
from fit_material.fitter.next_view.view_evaluation import WIDTH
from fit_material.fitter.observations.view_sampling import ANGLE_BINS, View, sampled_views
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from tests.fitter.observations.test_pixel_selection import photograph

MATTE, METAL = FITTABLE["matte"].foreseen(WIDTH), FITTABLE["metal"].foreseen(WIDTH)
SEEDS = st.integers(0, 2**31)


def a_view(pixels: int) -> View:
    """Pixels of a sphere, of which the picture has just these."""
    generator = torch.Generator().manual_seed(0)
    options = {"materials": 1, "count": pixels, "footprint": 1, "generator": generator}
    (view,) = sampled_views(gbuffer.tracer(Sphere()), photograph().camera, None, **options)
    return replace(view, available=torch.bincount(view.angle_bin, minlength=ANGLE_BINS).double())


def normal(*shape: int, seed: int) -> torch.Tensor:
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def even(view: View) -> torch.Tensor:
    """A noise of a tenth."""
    return torch.full((len(view.pixels),), 0.1, dtype=torch.float64)


def test_information_of_a_linear_model_is_the_textbooks():
    """L = 2 + A x with noise σ = 0.03 L: I = Aᵀ diag(σ⁻²) A, here by one product of whole matrices; of all pixels."""
    views, x = [a_view(120), a_view(60)], torch.zeros(4, dtype=torch.float64)
    sizes = [len(view.pixels) for view in views]
    design = 0.1 * normal(sum(sizes), 3, 4, seed=1)
    noise = torch.cat(
        [torch.full((size,), each, dtype=torch.float64) for size, each in zip(sizes, (0.03, 0.06), strict=True)]
    )
    told = told_by(views, lambda x: 2 + design @ x, x, noise)
    first, second = told.information(1e9)
    for found, part, noise in zip((first, second), design.split(sizes), (0.03, 0.06), strict=True):
        expected = part.reshape(-1, 4).T @ part.reshape(-1, 4) / (2 * noise) ** 2
        torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-9)


def test_half_the_pixels_of_even_light_tell_half():
    """Where every pixel tells the same, only their number counts, whichever angles they come from."""
    view, x = a_view(200), torch.ones(1, dtype=torch.float64)
    told = told_by([view], lambda x: x * torch.ones(len(view.pixels), 3, dtype=torch.float64), x, even(view))
    whole, half = (told.information(count)[0].item() for count in (len(view.pixels), len(view.pixels) / 2))
    assert whole == pytest.approx(3 * len(view.pixels) / 0.1**2, rel=1e-12)
    assert half == pytest.approx(whole / 2, rel=1e-12)


def random_told(seed: int, views: int, size: int) -> ViewInformation:
    """Pixels of random gradients, of sizes that differ by orders of magnitude."""
    roots = normal(views, ANGLE_BINS, size, 3, seed=seed) * 10 ** normal(views, 1, size, 1, seed=seed + 1)
    return ViewInformation(roots @ roots.mT, 300 * normal(views, ANGLE_BINS, seed=seed + 2).abs())


@given(SEEDS, st.floats(1, 5000), st.floats(1, 10))
def test_information_never_shrinks_by_a_view_or_by_more_pixels(seed, count, factor):
    """Positive semidefinite differences, to rounding: the sum over bins is of 16 terms."""
    told = random_told(seed, 3, 4)
    each, more = told.information(count), told.information(count * factor)
    for grown, before in ((each.sum(0), each[:2].sum(0)), (more.sum(0), each.sum(0))):
        least = torch.linalg.eigvalsh(grown - before).min()
        assert least > -1e-12 * grown.diagonal().max()


@given(SEEDS, st.floats(1, 5000))
def test_errors_never_grow_by_a_view(seed, count):
    """gᵀCg of every g: C's difference is positive semidefinite. Its inversions round by their condition, in units of
    the errors' own sizes: numbers differ by some 10³, their squares by 10⁶, which leaves 10 of 16 digits."""
    x = torch.zeros(7, dtype=torch.float64)
    each = random_told(seed, 3, 7).information(count)
    before, after = (covariance(part.sum(0), METAL, x) for part in (each[:2], each))
    scale = before.diagonal().rsqrt()
    difference = scale[:, None] * (before - after) * scale
    assert torch.linalg.eigvalsh((difference + difference.T) / 2).min() > -1e-6


def test_nothing_told_leaves_what_was_known_before():
    """A matte material has no prior: `VAGUE` in every direction; a metal's tint has one of width 1.5."""
    x = torch.zeros(4, dtype=torch.float64)
    torch.testing.assert_close(
        covariance(torch.zeros(4, 4, dtype=torch.float64), MATTE, x), VAGUE**2 * torch.eye(4).double()
    )
    x = torch.zeros(7, dtype=torch.float64)
    found = covariance(torch.zeros(7, 7, dtype=torch.float64), METAL, x).diagonal().sqrt()
    assert found[3:6].tolist() == pytest.approx([1 / math.hypot(1 / 1.5, 1 / VAGUE)] * 3)
    assert found[[0, 1, 2, 6]].tolist() == pytest.approx([VAGUE] * 4)


@given(st.lists(st.floats(0, 7), min_size=4, max_size=4))
def test_inverses_keep_their_digits_where_numbers_are_of_unlike_size(exponents):
    """D T D with T of 2 and -1 along its diagonals, whose inverse has min(i,k)(5 - max(i,k))/5, its condition 9;
    with D from 1 to 10⁷ an inversion as it stands would lose 14 digits. Each number's own size is the unit."""
    size = 10 ** torch.tensor(exponents, dtype=torch.float64)
    one = torch.eye(4, dtype=torch.float64)
    second = 2 * one - torch.diag(torch.ones(3).double(), 1) - torch.diag(torch.ones(3).double(), -1)
    found = covariance(size[:, None] * second * size - one / VAGUE**2, MATTE, torch.zeros(4, dtype=torch.float64))
    index = torch.arange(1, 5, dtype=torch.float64)
    inverse = torch.minimum(index[:, None], index) * (5 - torch.maximum(index[:, None], index)) / 5
    torch.testing.assert_close(size[:, None] * found * size, inverse, rtol=1e-12, atol=1e-12)


def rays(mirrored: torch.Tensor) -> GBuffer:
    """Rays that mirror these directions off a surface that they meet at 60°."""
    axis = torch.nn.functional.one_hot(mirrored.abs().argmin(-1), 3).double()
    across = torch.nn.functional.normalize(torch.linalg.cross(mirrored, axis), dim=-1)
    normal = 0.5 * mirrored + 0.75**0.5 * across
    hit = torch.ones(len(mirrored), dtype=torch.bool)
    flat, none = torch.zeros(len(mirrored), 4, dtype=torch.float64), torch.zeros(len(mirrored), dtype=torch.long)
    return GBuffer(hit, normal, normal, normal, flat[:, :2], normal - (mirrored - normal), none, none, flat)


@pytest.mark.parametrize("kind", ["metal", "glossy"])
def test_noise_is_foreseen_from_where_the_same_light_was_seen(kind):
    """Two lamps, one with 2 % of noise and one with 10 %; 96 values know it to 1/√192 = 7 %: four of these."""
    lamps = torch.tensor([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]], dtype=torch.float64)
    which = torch.arange(4000) % 2
    known = rays(torch.nn.functional.normalize(lamps[which] + 0.1 * normal(4000, 3, seed=3), dim=-1))
    difference = torch.tensor([0.02, 0.1], dtype=torch.float64)[which][:, None] * normal(4000, 3, seed=4)
    found = foreseen_noise(known, difference, rays(lamps), kind)
    assert found.tolist() == pytest.approx([0.02, 0.1], rel=0.28)


def test_noise_of_pixels_that_nobody_saw_is_a_finite_guess():
    lamp = rays(torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64))
    for known in (lamp[:0], lamp):
        found = foreseen_noise(known, torch.zeros(len(known.hit), 3, dtype=torch.float64), lamp, "metal")
        assert 0 < found.item() < 0.1
    assert len(foreseen_noise(lamp, torch.zeros(1, 3, dtype=torch.float64), lamp[:0], "metal")) == 0


def test_dark_pixels_do_not_count_as_noiseless():
    """Two in five are black: their noise is that of 5 % of the median, and their gradient of 1 tells (0.1·0.05)⁻²."""
    view = a_view(100)
    dark = torch.arange(len(view.pixels)) % 5 < 2
    level = torch.where(dark, 0.0, 1.0).double()[:, None].expand(-1, 3)
    told = told_by([view], lambda x: level + x, torch.zeros(1, dtype=torch.float64), even(view))
    expected = 3 * ((~dark).sum() / 0.1**2 + dark.sum() / (0.1 * 0.05) ** 2)
    assert told.information(1e9)[0].item() == pytest.approx(expected.item(), rel=1e-9)
