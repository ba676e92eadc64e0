"""Blocks of light: what they hold, how they are asked, and what that gains."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.light_kernel.llvm_integrator import fused_available
from fit_material.renderer.light_kernel.packed_rays import packed
from fit_material.renderer.light_sampling import environment_sampling, product_sampling
from fit_material.renderer.light_sampling.direction_sampling import LightSampler, asked_blocks
from fit_material.renderer.light_sampling.integrator import Integration, LobeGrid
from fit_material.renderer.light_tables import light_table
from fit_material.renderer.light_tables.torch_integrator import TorchIntegrator
from fit_material.renderer.rays.pixel_footprint import Rays
from tests.renderer.light_sampling.test_environment_sampling import cells, night, shares
from tests.renderer.light_tables.test_light_table import facing, shaded, white

LIGHT = night(32)


def test_blocks_hold_all_light_and_each_its_own():
    """Sums over texels by plain loops; a block's place is that of its rows and columns."""
    blocks = environment_sampling.build(LIGHT).blocks
    expected = np.zeros(product_sampling.ROWS * product_sampling.COLUMNS)
    for (row, column), share in np.ndenumerate(shares(LIGHT)):
        expected[
            row * product_sampling.ROWS // 32 * product_sampling.COLUMNS + column * product_sampling.COLUMNS // 64
        ] += share
    np.testing.assert_allclose(blocks.share.numpy(), expected, rtol=1e-5)
    np.testing.assert_allclose(blocks.first.numpy(), np.cumsum(expected) - expected, atol=1e-6)


def test_a_block_is_where_its_directions_are():
    """Directions drawn by the light of one block: all in its texels, and about its middle."""
    sampler = environment_sampling.build(LIGHT)
    blocks, generator = sampler.blocks, torch.Generator().manual_seed(2)
    for number in (5, 137, 300, 508):
        u = blocks.first[number] + blocks.share[number] * torch.rand(400, generator=generator).double()
        x, y, z, _ = environment_sampling.sample(sampler, u, *torch.rand(2, 400, generator=generator))
        cell = cells(LIGHT, *(axis.double().numpy() for axis in (x, y, z)))
        inside = blocks.at(torch.from_numpy(cell // 64), torch.from_numpy(cell % 64)) == number
        assert inside.double().mean() > 0.98  # float32 rounds some at a border into the neighbour
        middle = torch.nn.functional.normalize(torch.stack([x, y, z]).mean(1), dim=0)
        assert torch.rad2deg((middle @ blocks.towards[number]).clamp(-1, 1).acos()) < 1.5


def rays(n_dot_v: list[float]) -> Rays:
    surface = facing(n_dot_v)
    return Rays(surface.normal, surface.view)


@pytest.mark.parametrize("alpha", [0.005, 0.1, 0.7])
def test_chances_are_chances_and_leave_no_light_out(alpha):
    sampler = LightSampler.of(LIGHT)
    found = asked_blocks(sampler, rays([1.0, 0.5, 0.05]), alpha)
    torch.testing.assert_close(found.sum(1), torch.ones(3))
    lit = sampler.lamps.blocks.share > 0
    assert (found[:, lit] >= 0.999 * product_sampling.EVEN * sampler.lamps.blocks.share[lit]).all()


@pytest.mark.skipif(not fused_available(), reason="LLVM's library is absent")
@pytest.mark.parametrize("alpha", [0.02, 0.3])
def test_the_kernel_asks_as_torch_does(alpha):
    """Fixed point of 2³², its last block taking 2·10⁻⁵ that the rounding of float32 sums leaves over."""
    from fit_material.renderer.light_kernel.product_sampling import Asked, FusedBlocks

    seen, sampler = rays([0.9, 0.4, 0.1]), LightSampler.of(LIGHT)
    expected, there = asked_blocks(sampler, seen, alpha), packed(seen)
    widths = product_sampling.width(alpha, there.tilt)
    asked = Asked.by(FusedBlocks.of(sampler.lamps.blocks), there.mean, widths)
    ends = asked.ends.numpy().reshape(3, -1).astype(np.float64) / 2**32
    np.testing.assert_allclose(np.diff(ends, prepend=0, axis=1), expected.numpy(), rtol=1e-3, atol=3e-5)


def test_a_dim_lamp_beside_a_bright_one_is_found(monkeypatch):
    """A lamp of a thousandth of the light in the mirrored direction, the rest below the horizon.

    How much 300 pixels that see the same differ, with blocks and by the light alone, of whose 128 directions every
    eighth pixel gets one.
    """
    surface = facing([0.7] * 300)
    mirrored = (2 * surface.n_dot_v[0, 0] * surface.normal[0, 0] - surface.view[0, 0]).numpy()
    radiance = torch.full((64, 128, 3), 1e-4)
    cell = cells(Environment(radiance), *mirrored)
    radiance.view(-1, 3)[int(cell)] = 10.0
    dim, low = (latlong.row_solid_angle(64, 128)[row] for row in (int(cell) // 128, 60))
    radiance[60, 100] = 1e4 * dim / low

    def scattered() -> float:
        table = light_table.microfacet_table(
            surface,
            Environment(radiance),
            LobeGrid(0.2, 0.2, 1, "ggx"),
            Integration(degree=4, samples=256, seed=1),
            integrator=TorchIntegrator(),
        )
        picture = shaded(table, 0.2, white)[:, 0]
        return float(picture.std() / picture.mean())

    by_blocks = scattered()
    monkeypatch.setattr(product_sampling, "EVEN", 1.0)
    assert by_blocks < scattered() / 3
