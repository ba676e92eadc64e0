"""The compiled integration against torch's, quadrature, float64 and counts."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.light_kernel import llvm_integrator
from fit_material.renderer.light_kernel.llvm_integrator import LlvmIntegrator, fused_available
from fit_material.renderer.light_kernel.packed_rays import packed_frames
from fit_material.renderer.light_sampling import environment_sampling
from fit_material.renderer.light_sampling.integrator import Integration, LobeGrid
from fit_material.renderer.light_tables import light_table
from fit_material.renderer.light_tables.torch_integrator import TorchIntegrator
from fit_material.renderer.rays.local_frame import frames
from fit_material.shaders.optics import microfacets
from tests.renderer.light_sampling.test_environment_sampling import cells, night, shares
from tests.renderer.light_tables.test_light_table import DISTRIBUTIONS, ball, facing, lit_room, shaded, white
from tests.support.quadrature import albedo

needs_llvm = pytest.mark.skipif(not fused_available(), reason="LLVM's library is absent")


def table(surface, environment, alphas, distribution="ggx", integrator=None, progress=None, **options):
    integration = Integration(**{"degree": 4, "samples": 256, "seed": 1} | options)
    called = {} if progress is None else {"progress": progress}
    lobes, integrator = LobeGrid(*alphas, distribution), integrator or LlvmIntegrator()
    return light_table.microfacet_table(surface, environment, lobes, integration, integrator=integrator, **called)


def directions(count: int) -> torch.Tensor:
    """All over the sphere; the map's seam and what lies beside the poles, which have no azimuth, among them."""
    towards = torch.randn(count, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    towards[:4] = torch.tensor([[1e-4, 1.0, 2e-4], [1e-4, -1.0, -1e-4], [1e-7, 0.3, -1.0], [-1e-7, 0.3, -1.0]])
    return torch.nn.functional.normalize(towards, dim=-1).float()


@needs_llvm
@pytest.mark.parametrize("height", [1, 2, 16])
@pytest.mark.parametrize("rotation", [0.0, -75.0, 400.0])
def test_lookups_are_torchs(height, rotation):
    from drjit.llvm import Float

    from fit_material.renderer.light_kernel.environment import fused_light

    radiance = torch.rand(height, 32, 3, generator=torch.Generator().manual_seed(2))
    environment, towards = Environment(radiance, rotation), directions(4000)
    looked = fused_light(environment).at(*(Float(axis.numpy()) for axis in towards.T.contiguous()))
    found = torch.from_numpy(np.stack([channel.numpy() for channel in (*looked.radiance, looked.density)], -1))
    expected = latlong.lookup(
        latlong.of(environment, environment_sampling.sampling_density(environment)), *towards.unbind(-1)
    )
    # Dr.Jit's arctangent errs by 1e-6, arccosines near the poles and a rotation in float32 by as much: of 32 texels
    # to a turn these are 1e-5, between texels that differ by 1 at most
    torch.testing.assert_close(found, expected, atol=2e-5, rtol=0)


def drawn(environment: Environment, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions and densities for `count` strata of the light."""
    from drjit.llvm import Float, UInt32

    from fit_material.renderer.light_kernel.environment import fused_light

    generator = np.random.default_rng(4)
    share = ((np.arange(count) + generator.random(count)) * (2.0**32 / count)).astype(np.uint32)
    low_bits = tuple(Float(generator.random(count, dtype=np.float32)) for _ in range(2))
    towards, _, density = fused_light(environment).draw(UInt32(share), UInt32(0), low_bits)
    return np.stack([axis.numpy() for axis in towards]).astype(np.float64), density.numpy()


@needs_llvm
def test_directions_fall_with_the_light():
    environment, count = night(), 300_000
    towards, density = drawn(environment, count)
    np.testing.assert_allclose((towards**2).sum(0), 1, atol=1e-6)
    cell, expected = cells(environment, *towards), count * shares(environment).ravel()
    observed = np.bincount(cell, minlength=len(expected))
    # one direction to a stratum: of a texel only the strata at both its ends are left to chance, and some 1e-5 of all
    # directions are rounded into the neighbouring cell
    assert np.abs(observed - expected).max() < 2 + 3e-4 * count
    assert (np.abs(observed - expected) < 2 + 1e-3 * expected).mean() > 0.95
    told = environment_sampling.sampling_density(environment).flatten().numpy()[cell]
    # fixed point: a texel's share of 2³², at least 1e-5 here, is rounded by 1
    assert (np.abs(density / told - 1) < 1e-4).mean() > 0.999


@needs_llvm
def test_directions_are_even_within_a_texel():
    """Drawn along the Z-order curve: every cell of 16 × 16 of a texel holds its 1/256, but for one or two."""
    environment, count = Environment(torch.ones(4, 8, 3)), 32 * 4096
    towards, _ = drawn(environment, count)
    column = np.arctan2(towards[0], -towards[2]) / (2 * math.pi) % 1 * 8
    edges = np.cos(np.array([0.5, 1.5]) * math.pi / 3)
    down = (edges[0] - towards[1]) / (edges[0] - edges[1])
    inside = (down > 0) & (down < 1) & (column > 2) & (column < 3)
    observed, _, _ = np.histogram2d(down[inside], column[inside] - 2, 16, ((0, 1), (0, 1)))
    mean = inside.sum() / 256
    assert mean > 12
    assert np.abs(observed - mean).max() < 3  # binomial counts would stray by 4 σ, 15
    # the digits within are random
    assert np.unique(np.round(down[inside], 5)).size > 0.9 * inside.sum()


@needs_llvm
@given(
    st.floats(1e-3, 1), st.floats(0, 1), st.floats(0, 1), st.floats(0, 1.4), st.sampled_from(DISTRIBUTIONS)
)  # fmt: skip
def test_lobes_are_those_of_float64(alpha, u1, u2, angle, distribution):
    """The kernel in float32 against `shaders.optics.microfacets` in float64, of normals that the kernel draws."""
    from drjit.llvm import Float

    from fit_material.renderer.light_kernel import microfacets as kernel

    view = kernel.View(Float(math.sin(angle)), Float(math.cos(angle)))
    polar = Float(math.sqrt(u1)), Float(math.sin(2 * math.pi * u2)), Float(math.cos(2 * math.pi * u2))
    h = kernel.sample_visible_normals(view, Float(alpha), *polar)
    cos_v, u1, u2 = (torch.tensor(number, dtype=torch.float64) for number in (math.cos(angle), u1, u2))
    expected = microfacets.sample_visible_normals(cos_v, alpha, u1, u2)
    exact = [float(axis[0]) for axis in (h.x, h.y, h.z)]
    # √u1 and 1 - t² in float32 leave 1e-3 of the disc's radius at its rim, times α on the way to the normal
    np.testing.assert_allclose(exact, [axis.item() for axis in expected], atol=2e-3 * alpha + 1e-6)

    exact = np.array(exact) / np.linalg.norm(exact)
    cos_h, cos_l = exact[2], 2 * (math.sin(angle) * exact[0] + math.cos(angle) * exact[2]) * exact[2] - math.cos(angle)
    if cos_l < 1e-3 or cos_h < 1e-3:
        return
    cos_h, cos_l = (torch.tensor(cosine, dtype=torch.float64) for cosine in (cos_h, cos_l))
    density = microfacets.visible_normal_density(cos_v, cos_h, alpha).item()
    assert kernel.visible_normal_density(view, h, Float(alpha))[0] == pytest.approx(density, rel=1e-4)
    value = microfacets.reflected(cos_v, cos_l, cos_h, alpha, distribution).item()
    told = kernel.reflected(view, Float(cos_l.item()), h, Float(alpha), distribution)[0]
    # tan²/α² of Beckmann's exponent is below 100 wherever D is above 1e-43 of its peak: 100 ulps
    assert told == pytest.approx(value, rel=1e-4, abs=1e-30)


@needs_llvm
def test_the_poles_show_one_of_their_texels():
    from drjit.llvm import Float

    from fit_material.renderer.light_kernel.environment import fused_light

    room = lit_room()
    looked = fused_light(room).at(Float(0, 0), Float(1, -1), Float(0, 0))
    found = np.stack([channel.numpy() for channel in looked.radiance], -1)
    for pole, row in zip(found, (room.radiance[0], room.radiance[-1]), strict=True):
        assert ((row.numpy().min(0) <= pole) & (pole <= row.numpy().max(0))).all()


@needs_llvm
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("alpha", [0.005, 0.05, 0.2, 1.0])
def test_the_table_is_torchs(distribution, alpha):
    """Σ difference² as its expectation, Σ of both variances, and the mean within 5σ, for every function of the basis.

    The seeds differ: one would give the same rays to both. The ratio scatters by √(2/N); few pixels hold most of the
    noise, so that four runs have N of some 60.
    """
    *_, surface = ball(20)
    span = (alpha * 0.9, alpha, 2)  # two levels that share directions
    one, other = (
        torch.stack([
            table(surface, lit_room(40.0), span, distribution, integrator, samples=1024, seed=seed).light.double()
            for seed in seeds
        ])
        for integrator, seeds in ((LlvmIntegrator(), range(4)), (TorchIntegrator(), range(4, 8)))
    )  # fmt: skip
    size = other[..., :1, :].mean((0, 1, -1), keepdim=True)[0]
    difference = (one.mean(1) - other.mean(1)) / size
    variance = ((one[:, 0] - one[:, 1]) ** 2 + (other[:, 0] - other[:, 1]) ** 2) / (4 * size**2)
    for degree in range(4):
        off, expected = difference[:, :, :, degree], variance[:, :, :, degree]
        ratio = off.square().sum() / expected.sum()
        assert 0.4 < ratio < 2, (degree, ratio)
        noise = (expected[:, 0].mean(-1).sum().sqrt() / off[:, 0, :, 0].numel()).item()
        assert abs(off.mean().item()) < 5 * noise, (degree, off.mean(), noise)


@needs_llvm
def test_halves_and_pixels_are_alike_and_pixels_apart():
    """2000 pixels that see the same: no half is the greater one, and neighbours err by themselves."""
    light = table(facing([0.6] * 2000), lit_room(), (0.2, 0.2, 1), degree=1, samples=64).light[:, 0, :, 0, 0].double()
    apart = light[0] - light[1]
    assert apart.mean().abs() < 5 * apart.std() / math.sqrt(2000)
    assert 0.8 < light[0].std() / light[1].std() < 1.25  # 5σ of a ratio of two such numbers, √(1/2000) each
    # errors that pixels share would not fall with their number; those of the reference are a fifth of theirs
    many = table(facing([0.6] * 1000), lit_room(), (0.2, 0.2, 1), degree=1, samples=4096, seed=2).light
    error = light.mean(0) - many.double()[..., 0].mean()
    assert error.mean().abs() < 5 * error.std() / math.sqrt(2000)
    for step in (1, 2, 3, 7, 16):
        correlation = (error[step:] * error[:-step]).mean() / error.square().mean()
        assert correlation.abs() < 5 / math.sqrt(2000)


@needs_llvm
def test_chunks_change_nothing(monkeypatch):
    *_, surface = ball(24)
    whole = table(surface, lit_room(), (0.02, 0.8, 7), samples=16)
    monkeypatch.setattr(llvm_integrator, "_PIXELS", 50)
    monkeypatch.setattr(llvm_integrator, "_SAMPLES", 1)
    told: list[float] = []
    parts = table(surface, lit_room(), (0.02, 0.8, 7), samples=16, progress=told.append)
    assert torch.equal(parts.light, whole.light)
    assert len(told) == math.ceil(len(surface.hit) / 50)
    assert told == sorted(told)
    assert told[-1] == 1.0


@needs_llvm
def test_a_changed_environment_is_seen():
    room = lit_room()
    before = table(facing([0.5]), room, (0.2, 0.2, 1)).light
    room.radiance.mul_(2)
    torch.testing.assert_close(table(facing([0.5]), room, (0.2, 0.2, 1)).light, 2 * before)


@needs_llvm
@pytest.mark.parametrize("samples", [4, 12, 300])
@pytest.mark.parametrize("height", [1, 2])
def test_the_smallest_maps_and_odd_numbers_of_samples(height, samples):
    """A furnace of constant light shows every pixel the albedo."""
    even = Environment(torch.ones(height, 2 * height, 3))
    found = shaded(table(facing([0.9] * 300), even, (0.1, 0.1, 1), samples=samples), 0.1, white)[:, 0]
    # quadrature and float32 leave 1e-4
    expected = albedo(0.9, 0.1, "ggx")
    assert found.mean().item() == pytest.approx(expected, abs=5 * found.std().item() / math.sqrt(300) + 1e-4)


def test_frames_tell_small_angles():
    """1e-5 rad from the normal, where float32 cosines are 1."""
    angles = torch.tensor([1e-5, 1e-4, 1e-3], dtype=torch.float64)
    packed = packed_frames(facing(angles.cos().tolist()))[:, 0]
    torch.testing.assert_close(packed[:, 3].double(), angles.sin(), rtol=1e-5, atol=0)
    frame = frames(facing(angles.cos().tolist()), torch.zeros(1, dtype=torch.long))
    torch.testing.assert_close(frame.sin_v[:, 0].double(), angles.sin(), rtol=1e-5, atol=0)


@pytest.mark.parametrize("without", [False, True])
def test_torch_integrates_where_llvm_is_absent(without):
    """And Dr.Jit is not even imported before a table is asked for."""
    code = (
        "import sys; from fit_material.renderer.light_tables import light_table; assert 'drjit' not in sys.modules\n"
        "from tests.renderer.light_tables.test_light_table import facing, lit_room, table_at\n"
        "table_at(facing([0.5]), lit_room(), 0.3); print(light_table.fused_available())"
    )
    environment = {**os.environ, **({"FIT_MATERIAL_LLVM": "none"} if without else {})}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == str(fused_available() and not without)
