"""Cameras that could be: all round the object, like those that there are."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.next_view.candidate_views import (
    CLOSER,
    DIRECTIONS,
    TOO_NEAR,
    Viewpoint,
    angle_between,
    lattice,
    viewpoints,
)
from fit_material.renderer.geometry.bounds import Vector
from fit_material.renderer.geometry.mesh import Mesh, Shape, Sphere
from fit_material.renderer.scene.scene_file import CameraSpec, camera_of

COORDINATE = st.floats(-1, 1, allow_subnormal=False)


def unit(*values: float) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.tensor(values, dtype=torch.float64), dim=0)


def found(*specs: CameraSpec, shape: Shape = Sphere(), size: tuple[int, int] = (64, 48)) -> list[Viewpoint]:  # noqa: B008
    return viewpoints([camera_of(spec, *size) for spec in specs], specs, shape)


def origin(place: Viewpoint) -> Vector:
    assert place.spec.origin is not None
    return place.spec.origin


def front(**changes) -> CameraSpec:
    return CameraSpec.model_validate({"origin": (0.0, 0.0, 4.0), "target": (0.0, 0.0, 0.0)} | changes)


@given(st.integers(8, 200), st.tuples(COORDINATE, COORDINATE, COORDINATE).filter(lambda up: np.linalg.norm(up) > 0.1))
def test_the_lattice_is_even(count, up):
    """Sums over it are integrals: ∫ d = 0 and ∫ d dᵀ = I/3, along the axis but for 1/(3 count²), and across it
    as well as the golden angle spreads azimuths: sums of ζ cos(i g) are at most about 1/sin(g/2) = 1.1, over count."""
    axis = unit(*up)
    directions = lattice(count, axis)
    torch.testing.assert_close(directions.norm(dim=1), torch.ones(count, dtype=torch.float64))
    assert directions.mean(0).norm() < 2 / count
    assert (directions.T @ directions / count - torch.eye(3) / 3).abs().max() < 2 / count
    assert (directions @ axis).abs().max() < 1 - 0.9 / count  # a camera along `up` would not know its upwards


@given(st.floats(1e-9, math.pi - 1e-9))
def test_angles_keep_their_digits(radians):
    turned = torch.tensor([math.cos(radians), math.sin(radians), 0.0], dtype=torch.float64)
    assert math.radians(angle_between(unit(1, 0, 0), turned)) == pytest.approx(radians, rel=1e-6)


def test_they_are_like_the_photographs_and_look_at_the_object():
    """Their coordinates are rounded to a thousandth of the distance, the angle to half of that."""
    places = found(front())
    assert DIRECTIONS - 1 <= len(places) <= DIRECTIONS  # one may lie too near the photograph
    for place in places:
        camera = place.camera
        assert (camera.width, camera.height, camera.fov, camera.projection) == (64, 48, 35.0, "perspective")
        assert camera.camera_to_world[:3, 3].norm() == pytest.approx(4.0, rel=2e-3)
        backward, towards = camera.camera_to_world[:3, 2], unit(*camera.camera_to_world[:3, 3].tolist())
        assert angle_between(backward, towards) < 0.1
        cosine = (towards @ unit(0, 0, 1)).item()
        assert place.angle == pytest.approx(math.degrees(math.acos(cosine)), abs=0.1)
        assert place.angle >= TOO_NEAR


def test_the_nearest_photograph_is_told():
    places = found(front(), front(origin=(4.0, 0.0, 0.0)))
    for place in places:
        x, _, z = origin(place)
        if abs(x - z) > 0.01:
            assert place.nearest == (1 if x > z else 0)


@pytest.mark.parametrize(
    ("towards", "bearing"),
    [
        ((1, 0, 0), "right"),
        ((0, 1, 0), "top"),
        ((-1, 0, 0), "left"),
        ((0, -1, 0), "bottom"),
        ((1, 1, 0), "upper right"),
    ],
)
def test_bearings_are_those_of_the_picture(towards, bearing):
    """Seen from +Z, with +X to the right; the nearest of the lattice to 60° that way lies within 15° of it."""
    wanted = unit(0, 0, 1) * math.cos(math.radians(60)) + unit(*towards) * math.sin(math.radians(60))
    nearest = min(found(front()), key=lambda place: angle_between(unit(*origin(place)), wanted))
    assert bearing in nearest.bearing or nearest.bearing in bearing


def ball(radius: float, middle: tuple[float, float, float]) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    vertices, faces = np.asarray(made.vertices) + middle, np.asarray(made.faces)
    return Mesh(vertices, faces, None, None, np.zeros(len(faces), dtype=np.int64))


def test_a_small_object_is_seen_from_nearer_by_too():
    """A ball of a fifth of the frame: the nearer cameras stand where it fills all but 6 % of the height."""
    places = found(front(target=(0.3, 0.0, 0.0)), shape=ball(0.25, (0.3, 0.0, 0.0)))
    distances = [math.dist(origin(place), (0.3, 0.0, 0.0)) for place in places]
    near = [distance for distance in distances if distance < 3]
    half_angle = math.atan(math.tan(math.radians(35 / 2)) * 48 / 64)
    assert near == pytest.approx([1.06 * 0.25 / math.sin(half_angle)] * len(near), rel=2e-3)
    assert CLOSER - 3 <= len(near) <= CLOSER
    assert all(place.spec.target == (0.3, 0.0, 0.0) for place in places)


def test_orthographic_cameras_stay_orthographic():
    for place in found(front(projection="orthographic", scale=1.3)):
        assert (place.camera.projection, place.camera.scale) == ("orthographic", 1.3)


def test_poses_by_matrix_have_their_upwards():
    """Blender's worlds have +Z up; a camera at +X that has it upwards in the picture."""
    matrix = ((0.0, 0.0, 1.0, 4.0), (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    places = found(CameraSpec(matrix=matrix))
    assert all(place.spec.up == (0.0, 0.0, 1.0) for place in places)
    assert max(place.angle for place in places) > 165


def test_photographs_from_everywhere_leave_views_nevertheless():
    everywhere = [front(origin=tuple(4 * d for d in way)) for way in lattice(2000, unit(0, 1, 0)).tolist()]
    assert len(found(*everywhere)) == DIRECTIONS


def test_a_camera_that_stands_inside_the_bounding_sphere_is_answered_from_outside():
    """Nearer than the object's farthest corner, other directions might lie inside of it."""
    flat = ball(2.0, (0.0, 0.0, 0.0))
    flat = Mesh(flat.vertices * [1, 1, 0.1], flat.faces, None, None, flat.material)
    for place in found(front(origin=(0.0, 0.0, 0.5)), shape=flat):
        assert math.dist(origin(place), (0, 0, 0)) > 2.0
