"""Directions towards the light: their density, that they fall with it, and what it bounds."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.light_sampling import environment_sampling


def night(height: int = 12, rotation: float = 40.0) -> Environment:
    """Dim noise, one lamp in the open, one across the seam, one at the pole."""
    radiance = 0.1 * torch.rand(height, 2 * height, 3, generator=torch.Generator().manual_seed(1))
    radiance[4, 7] = torch.tensor([300.0, 200.0, 100.0])
    radiance[6, 0] = radiance[0, 3] = 50.0
    return Environment(radiance, rotation)


def draw(environment: Environment, count: int, seed: int = 2):
    u = torch.rand(3, count, generator=torch.Generator().manual_seed(seed))
    return environment_sampling.sample(environment_sampling.build(environment), *u)


def cells(environment: Environment, x, y, z) -> np.ndarray:
    """Row · width + column of the texel whose cell a world direction falls into, from angles."""
    height, width = environment.radiance.shape[:2]
    row = np.rint(np.arccos(np.clip(y, -1, 1)) / math.pi * (height - 1)).astype(int)
    u = np.arctan2(x, -z) / (2 * math.pi) + environment.rotation / 360
    return row * width + np.floor(u % 1 * width).astype(int) % width


def shares(environment: Environment) -> np.ndarray:
    """Probability of each texel by plain loops: mean of nine neighbours times solid angle."""
    light = environment.radiance.mean(2).double().numpy()
    height, width = light.shape
    middles = (np.arange(height + 1) - 0.5) * math.pi / (height - 1)
    edges = np.cos(np.clip(middles, 0, math.pi))
    found = np.zeros_like(light)
    for row in range(height):
        for column in range(width):
            rows = [min(max(row + j, 0), height - 1) for j in (-1, 0, 1)]
            nine = [light[r, (column + i) % width] for r in rows for i in (-1, 0, 1)]
            found[row, column] = sum(nine) / 9 * (edges[row] - edges[row + 1])
    return found / found.sum()


def test_density_is_the_smoothed_light_and_integrates_to_one():
    environment = night()
    solid_angle = latlong.row_solid_angle(12, 24)[:, None].numpy()
    found = environment_sampling.sampling_density(environment).double().numpy() * solid_angle
    np.testing.assert_allclose(found, shares(environment), rtol=1e-5)
    assert found.sum() == pytest.approx(1, abs=1e-6)


def test_directions_fall_with_the_density():
    environment, count = night(), 300_000
    x, y, z, density = draw(environment, count)
    torch.testing.assert_close(x**2 + y**2 + z**2, torch.ones(count), atol=1e-6, rtol=0)
    cell = cells(environment, *(c.double().numpy() for c in (x, y, z)))
    expected = count * shares(environment).ravel()
    observed = np.bincount(cell, minlength=len(expected))
    full = expected > 10
    chi2 = ((observed - expected)[full] ** 2 / expected[full]).sum()
    assert (chi2 - full.sum()) / math.sqrt(2 * full.sum()) < 5
    # float32 rounds one direction in 10⁵ into the neighbouring cell
    told = environment_sampling.sampling_density(environment).flatten()[cell]
    assert (density != told).float().mean() < 1e-3


def test_directions_are_even_within_a_texel():
    environment = Environment(torch.zeros(6, 12, 3))
    environment.radiance[2, 5] = 1.0
    _, y, _, _ = draw(environment, 100_000)
    edges = np.cos((np.arange(4) + 0.5) * math.pi / 5)  # rows 1, 2, 3 are drawn, each in proportion to its band
    position = (edges[0] - y.double().numpy()) / (edges[0] - edges[-1])
    observed, _ = np.histogram(position, 20, (0, 1))
    chi2 = ((observed - 5000) ** 2 / 5000).sum()
    assert (chi2 - 19) / math.sqrt(38) < 5


@pytest.mark.parametrize("normal", [(0.0, 1.0, 0.0), (0.6, -0.48, 0.64), (-1.0, 0.0, 0.0)])
def test_irradiance_is_estimated_without_bias(normal):
    environment, count = night(), 100_000
    x, y, z, density = draw(environment, count)
    light = latlong.lookup(latlong.of(environment), x, y, z).double()
    cosine = (normal[0] * x + normal[1] * y + normal[2] * z).clamp_min(0).double()
    terms = light * (cosine / density.double())[:, None]
    mean, error = terms.mean(0), terms.std(0) / math.sqrt(count)

    # midpoints in 600 × 1200 cells of polar angle and azimuth, 50 to a texel's side: the kinks cost (1/50)² of it
    theta = (torch.arange(600).double() + 0.5) * math.pi / 600
    phi = (torch.arange(1200).double() + 0.5) * math.pi / 600
    theta, phi = torch.meshgrid(theta, phi, indexing="ij")
    x, y, z = theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos()
    light = latlong.lookup(latlong.of(environment), x.float(), y.float(), z.float()).double()
    cosine = (normal[0] * x + normal[1] * y + normal[2] * z).clamp_min(0)
    expected = (light * (cosine * theta.sin())[..., None]).sum((0, 1)) * (math.pi / 600) ** 2
    assert ((mean - expected).abs() < 5 * error + expected / 50**2).all()


@given(st.integers(2, 10), st.integers(0, 1000))
def test_light_over_density_is_bounded(height, seed):
    """A lookup mixes four of the nine texels whose mean is the density, so L/p <= 9 times all light."""
    generator = torch.Generator().manual_seed(seed)
    environment = Environment(torch.rand(height, 2 * height, 3, generator=generator) ** 20)
    x, y, z, density = draw(environment, 1000, seed)
    light = latlong.lookup(latlong.of(environment), x, y, z).mean(-1)
    mean = environment.radiance.mean(2).double()
    spread = sum(torch.roll(mean[[0, *range(height), -1]], i, 1)[j : j + height] for i in (-1, 0, 1) for j in (0, 1, 2))
    total = (spread / 9 * latlong.row_solid_angle(height, 2 * height)[:, None]).sum()
    assert (density > 0).all()
    assert (light <= 9 * density * total * (1 + 1e-5) + 1e-7 * light.max()).all()


def test_light_is_drawn_where_it_is_seen():
    """Wherever a lookup finds light, the density is above zero, whatever the map's turn."""
    environment = Environment(torch.zeros(8, 16, 3), rotation=33.0)
    environment.radiance[3, 15] = 1.0
    towards = torch.nn.functional.normalize(torch.randn(20_000, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    lit = latlong.lookup(latlong.of(environment), *towards.unbind(-1)).mean(-1) > 1e-5
    assert lit.sum() > 100
    cell = cells(environment, *towards[lit].double().numpy().T)
    assert (environment_sampling.sampling_density(environment).flatten()[cell] > 0).all()


def test_strata_of_a_block_are_compact():
    """Of a map without lamps: a block's directions lie within its 11°, those of its sixteen strata within a quarter."""
    environment = Environment(torch.ones(256, 512, 3), 0.0)
    sampler = environment_sampling.build(environment)
    blocks, number = sampler.blocks, 8 * 32 + 5  # beside the horizon
    u = blocks.first[number] + blocks.share[number] * (torch.arange(16 * 64) + 0.5) / (16 * 64)
    half = torch.full((len(u),), 0.5)
    towards = torch.stack(environment_sampling.sample(sampler, u, half, half)[:3], -1).double()
    assert torch.rad2deg((towards @ blocks.towards[number].double()).clamp(-1, 1).acos()).max() < 11.25 / 2**0.5 + 1
    strata = towards.reshape(16, 64, 3)
    spread = torch.rad2deg((2 - 2 * strata.mean(1).norm(dim=-1)).clamp_min(0).sqrt())
    assert spread.max() < 11.25 / 4


@pytest.mark.parametrize("height", [1, 2])
def test_the_smallest_maps_are_drawn_evenly(height):
    environment = Environment(torch.ones(height, 2, 3))
    x, y, z, density = draw(environment, 50_000)
    torch.testing.assert_close(density, torch.full((50_000,), 1 / (4 * math.pi)))
    moments = torch.stack([x, y, z])
    # means of coordinates of σ = 1/√3, and of their squares of σ = √(4/45)
    assert moments.mean(1).abs().max() < 5 / math.sqrt(3 * 50_000)
    assert ((moments**2).mean(1) - 1 / 3).abs().max() < 5 * math.sqrt(4 / 45 / 50_000)
