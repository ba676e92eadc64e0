"""The maps made here: their energy against integrals taken another way, and that no two sides are alike."""

import itertools

import numpy as np
import pytest

from fit_material.renderer.environment.environment import directions
from fit_material.renderer.environment.latlong import texel_solid_angles
from fit_material.renderer.mitsuba.conversion import mitsuba
from fit_material.renderer.synthesis.studio import studio, sun_and_sky

pytestmark = pytest.mark.dr_jit


def test_texels_cover_the_sphere():
    towards, solid_angles = directions(64, 128).numpy(), texel_solid_angles(64, 128)
    assert np.broadcast_to(solid_angles, (64, 128)).sum() == pytest.approx(4 * np.pi, rel=1e-12)
    # a tent of half width δ lets the second harmonic pass but for (2δ)²/12 of it
    second = (towards[..., 1] ** 2 * solid_angles).sum()
    assert second == pytest.approx(4 * np.pi / 3, rel=(2 * np.pi / 63) ** 2 / 12)


def test_the_studio_is_finite_and_spans_three_decades():
    radiance = studio(256).radiance.numpy()
    assert radiance.shape == (256, 512, 3)
    assert radiance.dtype == np.float32
    assert np.isfinite(radiance).all()
    assert 0.04 < radiance.min() < 0.1
    assert 150 < radiance.max() < 250


def test_every_octant_of_the_studio_has_something_bright_and_something_dim():
    radiance, towards = studio(128).radiance.numpy().mean(-1), directions(128, 256).numpy()
    for octant in np.ndindex(2, 2, 2):
        inside = radiance[((towards > 0) == octant).all(-1)]
        assert inside.max() > 1, octant
        assert inside.min() < 0.45, octant


@pytest.mark.parametrize(("flip", "turn"), [*itertools.product([(), (0,), (1,), (0, 1)], range(0, 128, 16))][1:])
def test_the_studio_is_unlike_itself_mirrored_or_turned(flip, turn):
    radiance = np.log(studio(64).radiance.numpy())
    other = np.roll(np.flip(radiance, flip), turn, axis=1)
    assert np.abs(other - radiance).mean() > 0.2  # a fifth of an e-fold on average: no orientation passes for another


def test_the_studio_keeps_its_light_at_any_resolution():
    coarse, fine = (
        (studio(height).radiance.numpy() * texel_solid_angles(height, 2 * height)[..., None]).sum((0, 1))
        for height in (128, 512)
    )
    np.testing.assert_allclose(coarse, fine, rtol=0.005)


@pytest.fixture(scope="module")
def baked():
    return sun_and_sky(64, scale=1.0).radiance.numpy()


def test_sun_and_sky_keep_the_irradiance_of_the_emitter(baked):
    """Mitsuba's own sampling of the emitter, which hits the true disc, finds the same light on the ground."""
    mi = mitsuba("scalar_rgb")
    turn = mi.ScalarTransform4f().rotate([1, 0, 0], -90)
    sun = np.array([-0.55, 0.55, 0.62]) / np.linalg.norm([-0.55, 0.55, 0.62])
    emitter = mi.load_dict({"type": "sunsky", "sun_direction": sun.tolist(), "turbidity": 3.0, "to_world": turn})
    mi.load_dict({"type": "scene", "ball": {"type": "sphere"}, "sky": emitter})  # tells the emitter its scene's size
    point, found = mi.SurfaceInteraction3f(), []
    for u, v in np.random.default_rng(1).random((20_000, 2)).tolist():
        sample, weight = emitter.sample_direction(point, mi.Point2f(u, v))
        found.append(np.array(weight) * max(sample.d.y, 0))
    error = np.std(found, axis=0) / np.sqrt(len(found))
    assert (error < 0.01 * np.mean(found, axis=0)).all()  # else the comparison would say nothing
    above = np.clip(directions(64, 128).numpy()[..., 1:2], 0, None)
    baked_irradiance = (baked * above * texel_solid_angles(64, 128)[..., None]).sum((0, 1))
    # 4 σ of the sampling, and half a per cent for the sky's gradient at the horizon on a coarse map
    assert (np.abs(baked_irradiance - np.mean(found, axis=0)) < 4 * error + 0.005 * baked_irradiance).all()


def test_the_sun_stands_where_it_was_put(baked):
    row, column = np.unravel_index(baked.sum(-1).argmax(), (64, 128))
    towards, sun = directions(64, 128).numpy()[row, column], np.array([-0.55, 0.55, 0.62])
    assert np.degrees(np.arccos(towards @ sun / np.linalg.norm(sun))) < 180 / 63  # within one texel


def test_the_ground_is_matte_and_lit_by_sun_and_sky(baked):
    above = np.clip(directions(64, 128).numpy()[..., 1:2], 0, None)
    irradiance = (baked * above * texel_solid_angles(64, 128)[..., None]).sum((0, 1))
    expected = np.array([0.18, 0.15, 0.11]) * irradiance / np.pi
    np.testing.assert_allclose(baked[40:], np.broadcast_to(expected, baked[40:].shape), rtol=1e-5)
