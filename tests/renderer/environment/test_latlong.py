"""Lookups between the texels, at the seam and at the poles, against Mitsuba's `envmap`."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.mitsuba.conversion import envmap, mitsuba

EPS32 = 2.0**-23


def random_map(height: int, seed: int = 3) -> torch.Tensor:
    return torch.rand(height, 2 * height, 3, generator=torch.Generator().manual_seed(seed))


def lookup(environment: Environment, towards) -> np.ndarray:
    x, y, z = torch.as_tensor(np.asarray(towards), dtype=torch.float32).unbind(-1)
    return latlong.lookup(latlong.of(environment), x, y, z).numpy()


def seen_by_mitsuba(environment: Environment, towards: np.ndarray) -> np.ndarray:
    mi = mitsuba("scalar_rgb")
    emitter = mi.load_dict(envmap(environment))
    found = []
    for direction in towards:
        interaction = mi.SurfaceInteraction3f()
        interaction.wi = mi.Vector3f(*(-direction).tolist())
        found.append(np.array(emitter.eval(interaction)))
    return np.array(found)


def everywhere(count: int) -> np.ndarray:
    """Directions over the sphere, along the seam u = 0 on both sides of it, and around both poles."""
    rng = np.random.default_rng(5)
    anywhere = rng.normal(size=(count, 3))
    seam = np.stack([rng.uniform(-1e-2, 1e-2, count), rng.uniform(-1, 1, count), -np.ones(count)], -1)
    tilt = rng.normal(size=(count, 2)) * 1e-2
    poles = np.stack([tilt[:, 0], rng.choice([-1.0, 1.0], count), tilt[:, 1]], -1)
    towards = np.concatenate([anywhere, seam, poles])
    return towards / np.linalg.norm(towards, axis=-1, keepdims=True)


@pytest.mark.parametrize("rotation", [0.0, 40.0, -725.0])
def test_lookups_between_texels_are_mitsubas(rotation):
    environment = Environment(random_map(16), rotation)
    towards = everywhere(300)
    found, expected = lookup(environment, towards), seen_by_mitsuba(environment, towards)
    # float32's u, off by ε of up to three turns, moves a lookup by w times that; Mitsuba's by as much. Near the
    # poles, within 1e-2, the azimuth is off by 100 ε, and v, an arccosine, by √ε
    pole = np.abs(towards[:, 1]) > 0.9
    np.testing.assert_allclose(found[~pole], expected[~pole], atol=32 * 8 * 3 * EPS32)
    np.testing.assert_allclose(found[pole], expected[pole], atol=16 * 2 * math.sqrt(EPS32) / math.pi)


@pytest.mark.parametrize("rotation", [0.0, 40.0])
def test_the_meridian_has_no_seam(rotation):
    """Two directions 2e-5 apart across u = 0 differ by no more than the map's slope, w/2π per radian, allows."""
    turned = math.radians(rotation)
    y = np.linspace(-0.9, 0.9, 50)
    sides = []
    for azimuth in (-1e-5 - turned, 1e-5 - turned):
        across = np.full(50, azimuth)
        sides.append(np.stack([np.sin(across), y, -np.cos(across)], -1) / np.hypot(1, y)[:, None])
    found = [lookup(Environment(random_map(8), rotation), side) for side in sides]
    np.testing.assert_allclose(*found, atol=16 / (2 * math.pi) * 2e-5 + 16 * 8 * EPS32)


@pytest.mark.parametrize("y", [1.0, -1.0, 1 + 1e-6, -1 - 1e-6])
def test_poles_show_their_own_row_even_when_rounding_goes_beyond_them(y):
    radiance = random_map(8)
    found = lookup(Environment(radiance), [[0.0, y, 0.0]])[0]
    row = radiance[0 if y > 0 else -1].numpy()
    assert (found >= row.min(0) - EPS32).all()
    assert (found <= row.max(0) + EPS32).all()


def test_rotation_turns_counter_clockwise_seen_from_above():
    """Seen from +Y, with +X to the right and +Z downwards, a quarter turn carries +Z to +X."""
    towards = directions(9, 16).reshape(-1, 3).numpy()
    x, y, z = towards.T
    radiance = torch.rand(9, 16, 3, generator=torch.Generator().manual_seed(2))
    before = lookup(Environment(radiance), towards)
    after = lookup(Environment(radiance, 90.0), np.stack([z, y, -x], -1))
    between = slice(16, -16)  # the columns of the polar rows cannot be told apart
    np.testing.assert_allclose(after[between], before[between], atol=16 * 8 * EPS32)


def test_a_map_of_one_row_has_two_colours_around_the_horizon():
    environment = Environment(torch.tensor([[[1.0, 0, 0], [0, 0, 1.0]]]))
    found = lookup(environment, [[1.0, 0, 0], [-1.0, 0, 0], [0.6, 0.8, 0], [0, 0, 1.0], [0, 0, -1.0]])
    expected = [[1, 0, 0], [0, 0, 1], [1, 0, 0], [0.5, 0, 0.5], [0.5, 0, 0.5]]
    np.testing.assert_allclose(found, expected, atol=8 * EPS32)


def test_further_channels_are_looked_up_alike():
    radiance, further = random_map(8), torch.rand(8, 16, generator=torch.Generator().manual_seed(9))
    towards = torch.as_tensor(everywhere(20), dtype=torch.float32)
    found = latlong.lookup(latlong.of(Environment(radiance, 20.0), further), *towards.unbind(-1))
    alone = Environment(further[..., None].expand(8, 16, 3).contiguous(), 20.0)
    np.testing.assert_array_equal(found[:, :3], lookup(Environment(radiance, 20.0), towards))
    np.testing.assert_array_equal(found[:, 3], lookup(alone, towards)[:, 0])


@given(st.integers(1, 200), st.integers(1, 200))
def test_texels_share_the_sphere(height, width):
    found = latlong.row_solid_angle(height, width)
    assert found.sum().item() * width == pytest.approx(4 * math.pi, rel=1e-12)
    assert (found > 0).all()


@pytest.mark.parametrize("height", [2, 3, 9])
def test_solid_angles_are_those_between_the_rows(height):
    """Counted: of many directions evenly spread, each belongs to the row whose v = j/(h - 1) is nearest."""
    y = 1 - 2 * (np.arange(200_000) + 0.5) / 200_000
    row = np.rint(np.arccos(y) / math.pi * (height - 1)).astype(int)
    share = np.bincount(row, minlength=height) / 200_000 * 4 * math.pi / 7
    # each edge cuts one of the 200 000 bands
    np.testing.assert_allclose(latlong.row_solid_angle(height, 7), share, atol=2 * 4 * math.pi / 7 / 200_000)
