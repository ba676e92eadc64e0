"""Rays against Mitsuba's sensors, and the pose by what it must do."""

import mitsuba as mi
import numpy as np
import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st

from fit_material.renderer.cameras.camera import Camera, look_at

coordinate = st.floats(-10, 10, allow_subnormal=False)
point = st.tuples(coordinate, coordinate, coordinate)


def vector(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def mitsuba_sensor(camera: Camera, origin, target, up):
    """The same camera, said in Mitsuba's own words rather than by our matrix."""
    mi.set_variant("scalar_rgb")
    to_world = mi.ScalarTransform4f().look_at(origin, target, up)
    if camera.projection == "orthographic":
        to_world = to_world @ mi.ScalarTransform4f().scale([camera.scale, camera.scale, 1])
    lens = {"fov": camera.fov, "fov_axis": "x"} if camera.projection == "perspective" else {}
    film = {"type": "hdrfilm", "width": camera.width, "height": camera.height, "rfilter": {"type": "box"}}
    near = {"near_clip": 1e-3, "far_clip": 1e3}
    return mi.load_dict({"type": camera.projection, "to_world": to_world, "film": film, **lens, **near})


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("size", [(60, 40), (40, 60), (1, 1)])
def test_rays_are_those_of_mitsuba(projection, size):
    origin, target, up = (1.0, 2.0, 4.0), (0.2, -0.3, 0.1), (0.1, 1.0, -0.2)
    camera = Camera(look_at(vector(*origin), vector(*target), vector(*up)), *size, projection, 50.0, 1.3)
    sensor = mitsuba_sensor(camera, origin, target, up)
    positions = np.random.default_rng(5).random((30, 2))
    x, y = torch.from_numpy(positions * size).unbind(-1)
    start, direction = camera.rays(x, y)
    for index, position in enumerate(positions):
        ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(*position.tolist()), mi.Point2f(0.5))
        along = np.array(ray.d)
        # Mitsuba works in float32, and its projection matrix divides by near and far plane: 1e-5 is left
        np.testing.assert_allclose(direction[index], along, atol=1e-5)
        offset = start[index].numpy() - np.array(ray.o)
        np.testing.assert_allclose(np.cross(offset, along), 0, atol=1e-4)  # the same line, whatever its start


@given(point, point, point)
def test_the_centre_ray_meets_the_target(origin, target, up):
    origin, target, up = vector(*origin), vector(*target), vector(*up)
    view = torch.linalg.cross(up, origin - target)
    assume(view.norm() > 1e-3 * up.norm() * (origin - target).norm() > 1e-6)
    matrix = look_at(origin, target, up)
    camera = Camera(matrix, 31, 17, fov=40.0)
    start, direction = camera.rays(vector(15.5), vector(8.5))
    expected = torch.nn.functional.normalize(target - origin, dim=-1)
    # float64, of which the cross product with a nearly parallel up costs three digits
    torch.testing.assert_close(direction[0], expected, atol=1e-12, rtol=0)
    torch.testing.assert_close(start[0], origin)
    torch.testing.assert_close(matrix[:3, :3].T @ matrix[:3, :3], torch.eye(3).double(), atol=1e-12, rtol=0)
    assert torch.linalg.det(matrix) > 0
    assert matrix[:3, 1] @ up > 0


@given(st.floats(0.1, 179), st.integers(1, 5000), st.integers(1, 5000), st.floats(0, 1), st.floats(0, 1))
def test_rays_have_unit_length(fov, width, height, x, y):
    camera = Camera(look_at(vector(1, 2, 3), vector(0, 0, 0), vector(0, 1, 0)), width, height, fov=fov)
    _, direction = camera.rays(vector(x * width), vector(y * height))
    torch.testing.assert_close(direction.norm(dim=-1), vector(1), atol=1e-14, rtol=0)


def test_fov_is_the_angle_between_left_and_right_edge():
    camera = Camera(torch.eye(4).double(), 64, 16, fov=72.0)
    _, direction = camera.rays(vector(0, 64), vector(8, 8))
    angle = torch.rad2deg(torch.acos(direction[0] @ direction[1]))
    torch.testing.assert_close(angle, vector(72)[0])


def test_scale_is_half_the_width_of_an_orthographic_picture():
    camera = Camera(torch.eye(4).double(), 64, 32, "orthographic", scale=1.2)
    start, direction = camera.rays(vector(0, 64, 32), vector(0, 32, 16))
    torch.testing.assert_close(start, torch.stack([vector(-1.2, 0.6, 0), vector(1.2, -0.6, 0), vector(0, 0, 0)]))
    torch.testing.assert_close(direction, vector(0, 0, -1).expand(3, 3))


@pytest.mark.parametrize(
    ("target", "up"),
    [((1, 2, 3), (0, 1, 0)), ((0, 0, 0), (1, 2, 3)), ((0, 0, 0), (-2, -4, -6)), ((0, 0, 0), (0, 0, 0))],
)
def test_poses_that_are_none(target, up):
    with pytest.raises(ValueError, match="coincide or are parallel"):
        look_at(vector(1, 2, 3), vector(*target), vector(*up))
