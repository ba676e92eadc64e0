"""Moving cameras: no flips, no NaN, straight up and straight down included."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.opengl.geometry import Bounds
from fit_material.renderer.viewer.eye import Eye, eye_of, frame, look_round, orbit, pan, walk, zoom

BOUNDS = Bounds(np.array([0.5, -1.0, 2.0]), 1.5)

angles = st.floats(-10, 10)
pitches = st.one_of(st.floats(-math.pi / 2, math.pi / 2), st.sampled_from([-math.pi / 2, 0.0, math.pi / 2]))
coordinates = st.floats(-100, 100)
eyes = st.builds(
    Eye,
    target=st.tuples(coordinates, coordinates, coordinates),
    distance=st.floats(1e-3, 1e3),
    yaw=st.floats(-math.pi, math.pi),
    pitch=pitches,
    roll=st.sampled_from([0.0, 0.3, -2.0]),
    fov=st.floats(1, 120),
)


def view(eye: Eye) -> np.ndarray:
    return eye.camera(4, 3).camera_to_world.numpy()


def assert_rigid(matrix: np.ndarray) -> None:
    assert np.isfinite(matrix).all()
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-14)  # a few products of sines
    assert np.linalg.det(matrix[:3, :3]) > 0


def projected(camera: Camera, point: np.ndarray) -> np.ndarray:
    """Film position of a point in shares of half the width, by the pinhole's own division."""
    x, y, z = np.linalg.inv(camera.camera_to_world.numpy())[:3] @ [*point, 1.0]
    return np.array([x, y]) / -z / math.tan(math.radians(camera.fov / 2))


@given(eyes, st.lists(st.tuples(angles, angles), max_size=5))
def test_orbit_keeps_target_and_distance_and_never_turns_over(eye, turns):
    level = Eye(eye.target, eye.distance, eye.yaw, eye.pitch)  # not rolled
    for turn in turns:
        level = orbit(level, *turn)
        matrix = view(level)
        assert_rigid(matrix)
        assert matrix[1, 1] >= -1e-15  # the picture's up never points down
        assert abs(matrix[1, 0]) <= 1e-15  # and its right stays level
        to_target = np.array(level.target) - matrix[:3, 3]
        expected = -level.distance * matrix[:3, 2]
        np.testing.assert_allclose(to_target, expected, atol=1e-13 * (100 + level.distance))  # positions' rounding
    assert (level.target, level.distance) == (eye.target, eye.distance)


@given(eyes, angles, angles)
def test_looking_round_stays_on_the_spot(eye, yaw, pitch):
    turned = look_round(eye, yaw, pitch)
    assert_rigid(view(turned))
    np.testing.assert_allclose(turned.origin, eye.origin, atol=1e-13 * (200 + eye.distance))


@given(st.floats(-math.pi, math.pi), pitches)
def test_a_small_turn_changes_little(yaw, pitch):
    """Also at the poles, where matrices made from an up vector would jump."""
    eye = Eye((0.0, 0.0, 0.0), 1.0, yaw, pitch)
    step = 1e-6
    assert np.abs(view(orbit(eye, step, step)) - view(eye)).max() <= 2 * step + 1e-15


@given(eyes)
def test_the_eye_of_a_camera_sees_the_same(eye):
    camera = eye.camera(4, 3)
    again = eye_of(camera, eye.target)
    # angles come from components near the poles no better than the threshold 1e-9 below which roll counts as yaw
    np.testing.assert_allclose(view(again)[:3, :3], view(eye)[:3, :3], atol=1e-8)
    np.testing.assert_allclose(view(again)[:3, 3], view(eye)[:3, 3], atol=1e-8 * (100 + eye.distance))
    assert again.fov == eye.fov


@given(st.tuples(coordinates, coordinates, coordinates), st.tuples(coordinates, coordinates, coordinates))
def test_look_at_and_the_eye_agree(origin, target):
    """look_at makes the same matrix by cross products."""
    apart = np.subtract(origin, target)
    if np.hypot(apart[0], apart[2]) < 1e-3 * np.linalg.norm(apart) or np.linalg.norm(apart) < 1e-3:
        return  # which look_at refuses, or rounds
    matrix = look_at(*(torch.tensor(v, dtype=torch.float64) for v in (origin, target, (0.0, 1.0, 0.0))))
    eye = eye_of(Camera(matrix, 4, 3), target)
    np.testing.assert_allclose(view(eye), matrix, atol=1e-9)
    np.testing.assert_allclose(eye.target, target, atol=1e-9)
    assert eye.roll == pytest.approx(0, abs=1e-9)


def test_a_target_on_the_spot_or_behind_gives_a_distance():
    camera = Camera(torch.eye(4, dtype=torch.float64), 4, 3)  # at the origin, looking along -Z
    assert eye_of(camera, (0.0, 0.0, 0.0)).distance == 1
    assert eye_of(camera, (0.0, 0.0, 5.0)).target == (0, 0, -5)
    assert eye_of(camera, (3.0, 0.0, 0.0)).distance == 3


@given(eyes, st.floats(1e-6, 1e6))
def test_zoom_stays_within_its_limits_and_keeps_the_direction(eye, factor):
    zoomed = zoom(eye, factor, BOUNDS)
    assert 1e-3 * BOUNDS.radius <= zoomed.distance <= 1e3 * BOUNDS.radius
    assert zoomed.scale / eye.scale == pytest.approx(zoomed.distance / eye.distance)
    np.testing.assert_array_equal(view(zoomed)[:3, :3], view(eye)[:3, :3])


@given(eyes, st.floats(-0.9, 0.9), st.floats(-0.9, 0.9))
def test_pan_moves_the_target_by_shares_of_the_picture(eye, right, up):
    """What was in the middle is then seen there, by the pinhole's projection."""
    small = Eye((0.0, 0.0, 0.0), 1.0, eye.yaw, eye.pitch, eye.roll, fov=eye.fov)
    moved = pan(small, right, up)
    np.testing.assert_allclose(projected(moved.camera(4, 3), np.zeros(3)), [-right, -up], atol=1e-12)


def test_walking_follows_the_eye_and_the_vertical():
    eye = Eye((0.0, 0.0, 0.0), 2.0, yaw=math.pi / 2, pitch=0.5)  # looks along -X and up
    assert walk(eye, 1.0, 0.0, 0.0).target == pytest.approx((0, 0, -1))
    assert walk(eye, 0.0, 1.0, 0.0).target == pytest.approx((0, 1, 0))
    assert walk(eye, 0.0, 0.0, 1.0).target == pytest.approx((-math.cos(0.5), math.sin(0.5), 0))
    np.testing.assert_allclose(walk(eye, 1.0, 2.0, 3.0).rotation, eye.rotation)


@given(eyes, st.floats(0.2, 5), st.sampled_from(["perspective", "orthographic"]))
def test_a_framed_model_fills_the_picture_and_no_more(eye, aspect, projection):
    """The cone that touches the bounding sphere has the half angle asin(radius/distance)."""
    bent = Eye(eye.target, eye.distance, eye.yaw, eye.pitch, eye.roll, projection, eye.fov)
    framed = frame(bent, BOUNDS, aspect)
    assert framed.target == tuple(BOUNDS.centre)
    assert framed.roll == 0
    shorter = min(1.0, 1 / aspect)  # half the shorter side in half widths
    if projection == "orthographic":
        filled = BOUNDS.radius / framed.scale / shorter
    else:
        tan_seen = math.tan(math.asin(BOUNDS.radius / framed.distance))
        filled = tan_seen / math.tan(math.radians(framed.fov / 2)) / shorter
    assert 0.85 < filled <= 1 / 1.06 + 1e-12 or (filled <= 1 and framed.fov > 90)
