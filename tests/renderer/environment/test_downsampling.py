"""A smaller environment map, against sums over the sphere."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from fit_material.renderer.environment.downsampling import box_filtered
from fit_material.renderer.environment.latlong import row_solid_angle


def noise_map(height: int, width: int) -> Tensor:
    return torch.rand(height, width, 3, generator=torch.Generator().manual_seed(height))


def flux(radiance: Tensor) -> Tensor:
    solid_angle = row_solid_angle(*radiance.shape[:2])
    return (radiance.double() * solid_angle[:, None, None]).sum((0, 1))


def texel_of(theta: Tensor, phi: Tensor, height: int, width: int) -> Tensor:
    """row · width + column by the layout that `environment.directions` states, rows centred on j/(h - 1)."""
    row = (theta / math.pi * (height - 1) + 0.5).floor().long()
    return row[:, None] * width + (phi / (2 * math.pi) * width).floor().long()


@given(st.integers(8, 40), st.integers(1, 19))
def test_all_light_stays(height, half):
    """Flux is a sum of some thousand float32 values in [0, 1), each rounded to 6e-8 of itself."""
    radiance = noise_map(height, 2 * height)
    smaller = box_filtered(radiance, 2 * half)
    assert smaller.shape == ((half, 2 * half, 3) if half < height else radiance.shape)
    torch.testing.assert_close(flux(smaller), flux(radiance), rtol=1e-6, atol=0)


@pytest.mark.parametrize(("height", "width"), [(16, 8), (12, 10), (17, 22)])
def test_each_texel_is_the_mean_over_its_part_of_the_sphere(height, width):
    """Midpoint sums over θ and φ: only a cell's share of its n² points along an edge, 2/n, may fall on the wrong side.

    Both grids cut a coarse texel's side into at least 100 points, so that a mean of values in [0, 1) errs by less
    than 2 · 2/100 · the spread of the values, of which chance takes most: 0.01 was 3 times the largest seen.
    """
    radiance, (rows, columns) = noise_map(height, 2 * height), (width // 2, width)
    theta = (torch.arange(4000, dtype=torch.float64) + 0.5) * math.pi / 4000
    phi = (torch.arange(3960, dtype=torch.float64) + 0.5) * 2 * math.pi / 3960
    fine, coarse = (texel_of(theta, phi, *size).flatten() for size in ((height, 2 * height), (rows, columns)))
    weight = theta.sin()[:, None].expand(-1, len(phi)).flatten()
    total = torch.zeros(rows * columns, dtype=torch.float64).index_add_(0, coarse, weight)
    for channel in range(3):
        light = weight * radiance[..., channel].flatten()[fine].double()
        mean = torch.zeros_like(total).index_add_(0, coarse, light) / total
        found = box_filtered(radiance, width)[..., channel].flatten().double()
        torch.testing.assert_close(found, mean, atol=0.01, rtol=0)


def test_a_map_that_is_small_enough_stays_itself():
    radiance = noise_map(8, 16)
    assert all(box_filtered(radiance, width) is radiance for width in (0, 16, 64))
