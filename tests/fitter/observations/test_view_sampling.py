"""What a picture would give to a fit, known from a sample of its pixels, against counting all of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import choose_pixels
from fit_material.fitter.observations.view_sampling import ANGLE_BINS, histogram, sampled_views, taken_evenly
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.geometry.mesh import Mesh, Shape, Sphere
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.self_visibility import sees_itself
from tests.fitter.observations.test_pixel_selection import halves, photograph
from tests.renderer.rays.test_self_visibility import bowl


def pair() -> Mesh:
    """Two balls side by side, which mirror each other where they face each other."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    vertices = np.concatenate([np.asarray(ball.vertices) + np.array([x, 0, 0]) for x in (-0.6, 0.6)])
    faces = np.concatenate([ball.faces, ball.faces + len(ball.vertices)])
    normals = np.concatenate([np.asarray(ball.vertices) / 0.5] * 2)
    return Mesh(vertices, faces, normals, None, np.zeros(len(faces), dtype=np.int64))


BOWL, HALVES, PAIR = bowl(), halves(), pair()
COUNTS = st.lists(st.integers(0, 60), min_size=1, max_size=20)


def dealt(available: list[int], count: int) -> list[int]:
    """One of each bin in turn, until there are enough or none is left."""
    taken = [0] * len(available)
    while sum(taken) < min(count, sum(available)):
        for i, most in enumerate(available):
            if taken[i] < most and sum(taken) < count:
                taken[i] += 1
    return taken


@given(COUNTS, st.integers(0, 900))
def test_pixels_are_taken_as_if_dealt_in_turn(available, count):
    """The level is no whole number where dealing ends inside a round: each bin is less than one off."""
    taken = taken_evenly(torch.tensor(available, dtype=torch.float64), count)
    assert taken.sum().item() == pytest.approx(min(count, sum(available)), abs=1e-9)
    for ours, turn in zip(taken.tolist(), dealt(available, count), strict=True):
        assert abs(ours - turn) < 1 + 1e-9


def view(camera: Camera, shape: Shape, *, allowed=None, materials: int = 1, count: int = 200):
    generator = torch.Generator().manual_seed(3)
    options = {"materials": materials, "count": count, "footprint": 2, "generator": generator}
    return sampled_views(gbuffer.tracer(shape), camera, allowed, **options)


def counted(camera: Camera, shape: Shape, material: int = 0) -> torch.Tensor:
    """All pixels of a picture that a fit could take, by bin."""
    trace = gbuffer.tracer(shape)
    row, column = (grid.flatten() for grid in torch.meshgrid(*[torch.arange(camera.width)] * 2, indexing="ij"))
    surface = gbuffer.pixel_footprints(trace, camera, column, row, 2)
    centre = gbuffer.pixel_centres(trace, camera).reshape(len(row))
    whole = (surface.front & (surface.material == material)).all(1) & centre.front & (centre.material == material)
    whole[whole.clone()] &= ~sees_itself(trace, centre[whole])
    return torch.histc(centre.n_dot_v[whole].float(), ANGLE_BINS, 0, 1).double()


@pytest.mark.parametrize("shape", [Sphere(), PAIR, HALVES], ids=["sphere", "pair", "halves"])
def test_the_picture_is_counted_by_a_sample(shape):
    """Each pixel of a bin stands for w of the picture's, so that a count of N is known to √(wN), the whole to √(ΣwN);
    four of these are allowed, and of a bin one pixel more."""
    camera = photograph((3.99, 0.0, 0.3)).camera if shape is HALVES else photograph().camera
    for material, sampled in enumerate(view(camera, shape, materials=2 if shape is HALVES else 1)):
        expected = counted(camera, shape, material)
        weight = sampled.available / histogram(sampled.angle_bin).clamp_min(1)
        off = (sampled.available - expected).abs()
        assert (off <= 4 * (weight * expected).sqrt() + weight.clamp_min(20 * (weight == 0))).all(), (off, expected)
        assert (sampled.available.sum() - expected.sum()).abs() < 4 * (weight * expected).sum().sqrt()
        assert expected.sum() > 100
        if shape is PAIR:
            assert expected.sum() < 0.8 * gbuffer.pixel_centres(gbuffer.tracer(PAIR), camera).front.sum()


def test_a_fit_takes_what_is_foreseen():
    """Of two photographs, as many pixels of each angle as `choose_pixels` takes: within 4 √N and the rim's whims."""
    pictures = [photograph(size=64), photograph((4.0, 0.0, 0.0), size=64)]
    (chosen,) = choose_pixels(PixelRequest(pictures, gbuffer.tracer(Sphere()), Path("s.toml"), 2, seed=0), 1000)
    assert chosen is not None
    foreseen = sum(taken_evenly(view(each.camera, Sphere())[0].available, 500) for each in pictures)
    middle = chosen.surface.n_dot_v.mean(1)
    found = torch.histc(middle.float(), ANGLE_BINS, 0, 1).double()
    assert ((found - foreseen).abs() <= 4 * foreseen.sqrt() + 4).all(), (found, foreseen)
    assert foreseen.max() < 2 * 500 / 8  # no angle has much more than its share


def test_the_mask_is_kept_to():
    mask = torch.zeros(96, 96, dtype=torch.bool)
    mask[40:50, 40:60] = True
    (sampled,) = view(photograph().camera, Sphere(), allowed=mask)
    assert mask[tuple(sampled.pixels.T)].all()
    assert sampled.available.sum() == 200
    assert len(sampled.pixels) == 200


def test_what_mirrors_the_object_counts_in_photographs_that_have_nothing_else():
    """The bowl's wall at 45° mirrors the opposite wall."""
    camera = photograph().camera
    surface = gbuffer.pixel_centres(gbuffer.tracer(BOWL), camera)
    wall = surface.front & ((surface.position[..., 2] + 0.5).abs() < 0.1)
    (taken,) = view(camera, BOWL, allowed=wall)
    assert sees_itself(gbuffer.tracer(BOWL), taken.surface[:, 0]).all()
    assert len(taken.pixels) > 50


def test_a_picture_of_nothing_is_empty():
    away = photograph(target=(0.0, 0.0, 8.0)).camera
    for shape in (Sphere(), BOWL):
        (sampled,) = view(away, shape)
        assert (len(sampled.pixels), sampled.available.sum().item()) == (0, 0)
