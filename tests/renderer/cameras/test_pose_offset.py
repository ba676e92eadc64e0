"""Cameras moved by six numbers, and outlines that say by how much."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from fit_material.fitter.poses.silhouette_alignment import Border, border_of
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.cameras.lens import Lens
from fit_material.renderer.cameras.pose_offset import DEGREES, SHARE, Pose
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh, Sphere
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.scene.scene_file import CameraSpec, PhotographSpec

SIZE, FOV, RAYS = 48, 35.0, 12
AWAY = 3.6


def vector(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def camera(size: int = SIZE, **changes: object) -> Camera:
    pose = look_at(vector(1.0, 0.8, math.sqrt(AWAY**2 - 1.64)), vector(0, 0, 0), vector(0, 1, 0))
    return replace(Camera(pose, size, size, fov=FOV), **changes)


def egg() -> Mesh:
    """A body with three different axes, turned: six numbers of a camera change its outline."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    turned = np.asarray(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))[:3, :3]
    vertices = ball.vertices * [1.0, 0.6, 0.4] @ turned.T
    vertices = vertices + 0.15 * np.sin(3 * vertices[:, [1, 2, 0]])
    faces = np.asarray(ball.faces)
    return Mesh(vertices, faces, None, None, np.zeros(len(faces), int))


def coverage(shape: Mesh | Sphere, taken_by: Camera) -> np.ndarray:
    """The share of a grid of rays in each pixel that meets the object."""
    place = (torch.arange(SIZE * RAYS, dtype=torch.float64) + 0.5) / RAYS
    y, x = (each.flatten() for each in torch.meshgrid(place, place, indexing="ij"))
    hit = gbuffer.tracer(shape)(*taken_by.rays(x, y)).hit
    return hit.reshape(SIZE, RAYS, SIZE, RAYS).double().mean((1, 3)).numpy()


def off(pose: Pose, seed: int, degrees: float = 2.0, share: float = 0.01) -> Pose:
    """The pose by a camera that is so far off, which is then the given one."""
    chance = torch.randn(2, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    turn, shift = torch.nn.functional.normalize(chance, dim=-1)
    wrong = pose.by(torch.cat([turn * degrees / DEGREES, shift * share / SHARE]))
    return replace(wrong, given=wrong.camera, motion=torch.zeros(6, dtype=torch.float64))


def left(pose: Pose, true: Camera) -> tuple[float, float]:
    """Degrees and share of the distance by which a pose is off."""
    relative = torch.linalg.inv(true.camera_to_world) @ pose.camera.camera_to_world
    cosine = ((relative[:3, :3].trace() - 1) / 2).clamp(-1, 1)
    return math.degrees(math.acos(float(cosine))), float(relative[:3, 3].norm()) / pose.distance


@pytest.mark.parametrize("axis", range(6))
def test_a_number_turns_or_shifts_by_its_standard_deviation_in_the_cameras_own_axes(axis):
    pose = Pose.of(camera(), Sphere())
    moved = pose.by(torch.eye(6).double()[axis] * 1.5)
    rotation, origin = pose.given.camera_to_world[:3, :3], pose.given.camera_to_world[:3, 3]
    if axis < 3:
        own = rotation[:, axis]
        angle = math.radians(1.5 * DEGREES)
        other = rotation[:, (axis + 1) % 3]
        turned = other * math.cos(angle) + torch.linalg.cross(own, other) * math.sin(angle)  # Rodrigues, ⟂ to the axis
        torch.testing.assert_close(moved.camera.camera_to_world[:3, (axis + 1) % 3], turned)
        torch.testing.assert_close(moved.camera.camera_to_world[:3, 3], origin)
        assert moved.degrees == pytest.approx(1.5 * DEGREES)
        assert moved.share == 0
    else:
        torch.testing.assert_close(
            moved.camera.camera_to_world[:3, 3], origin + 1.5 * SHARE * AWAY * rotation[:, axis - 3]
        )
        torch.testing.assert_close(moved.camera.camera_to_world[:3, :3], rotation)
        assert moved.share == pytest.approx(1.5 * SHARE)


@pytest.mark.parametrize(
    "taken_by",
    [
        camera(),
        camera(lens=Lens(70.0, 70.0, 24.0, 24.0, k1=-0.05)),
        camera(projection="orthographic", scale=1.2),
    ],
    ids=["pinhole", "lens", "orthographic"],
)
def test_per_pixel_moves_the_outline_by_about_a_pixel(taken_by):
    pose = Pose.of(taken_by, Sphere())
    aside = vector(0, 1, 0, 0, 0, 0) * pose.per_pixel
    before, after = (torch.from_numpy(coverage(Sphere(), each.camera)) for each in (pose, pose.by(aside)))
    place = torch.arange(SIZE) + 0.5
    centre = [float((each.sum(0) * place).sum() / each.sum()) for each in (before, after)]
    assert abs(centre[1] - centre[0]) == pytest.approx(1, abs=0.15)  # perspective and distortion: it is a measure only


@pytest.mark.parametrize("seed", [0, 1])
def test_an_outline_with_three_axes_tells_all_of_a_pose(seed):
    shape, true = egg(), camera()
    border = Border.of(coverage(shape, true))
    trace = gbuffer.tracer(shape)
    wrong = off(Pose.of(true, shape), seed)
    pose = border.registered(wrong, trace)
    rows = border.rows(pose, trace, border.reach(pose))
    error = torch.linalg.inv(rows.information).diagonal().sqrt()
    degrees, share = left(pose, true)
    assert degrees < 4 * DEGREES * float(error[:3].norm())  # four of its own standard errors
    assert share < 4 * SHARE * float(error[3:].norm())
    assert max(degrees / DEGREES, share / SHARE) < 0.6  # at 48², where its own errors are a tenth to a fifth
    assert border.apart(wrong, trace) > 0.5
    assert border.apart(pose, trace) < 0.1  # pixels; straight lines between the pixels' middles are off by up to 0.08


def test_a_balls_outline_tells_where_it_is_and_leaves_the_rest_as_it_was():
    true, shape = camera(), Sphere()
    border, trace = Border.of(coverage(shape, true)), gbuffer.tracer(shape)
    wrong = off(Pose.of(true, shape), 3)
    pose = border.registered(wrong, trace)
    middle = torch.linalg.inv(pose.camera.camera_to_world)[:3, 3]  # of the ball, seen by the camera
    torch.testing.assert_close(middle / AWAY, vector(0, 0, -1), atol=5e-4, rtol=0)  # a fortieth of a pixel
    assert float(pose.motion.norm()) < math.sqrt(2) + 0.02  # no further than it was off: one deviation of each kind
    rows = border.rows(pose, trace, border.reach(pose))
    known = torch.linalg.eigvalsh(rows.information)
    assert known[2] < 1 < known[3]  # beside the prior, which is 1: three directions of six


def test_a_border_along_the_frame_is_none():
    half = np.zeros((20, 20))
    half[:, :7] = 1
    border = Border.of(half)
    assert len(border.place)
    torch.testing.assert_close(border.place[:, 0], torch.full((len(border.place),), 7.0).double())
    torch.testing.assert_close(border.outward, vector(1, 0).expand(len(border.place), -1))


def photograph(folder: Path, channels: int, alpha: float = 1.0) -> PhotographSpec:
    pixels = np.full((8, 8, channels), alpha, np.float32)
    write_exr(folder / "view.exr", pixels)
    return PhotographSpec(image=folder / "view.exr", camera=CameraSpec(origin=(0, 0, 4), target=(0, 0, 0)))


@pytest.mark.parametrize(("channels", "found"), [(3, "missing"), (4, "without a border")])
def test_a_photograph_without_an_outline_is_refused(tmp_path, channels, found):
    with pytest.raises(InputError) as caught:
        border_of(photograph(tmp_path, channels), (tmp_path / "scene.toml", "photographs[1]"))
    expected = "an alpha channel or a mask, whose border is the object's outline, for --refine-pose"
    assert str(caught.value) == f"{tmp_path / 'scene.toml'}: photographs[1].mask: is {found}, expected {expected}"
