"""Where a camera really stood: the pose that was given, moved by six small numbers in the camera's own axes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.geometry.bounds import bounding_sphere
from fit_material.renderer.geometry.mesh import Shape

DEGREES, SHARE = 2.0, 0.01  # standard deviations of a pose's error: of each rotation, of each shift over the distance

Motion = Float[Tensor, "6"]
"""Rotations about right, up, backward, and shifts along them, each over its standard deviation."""


@dataclass(frozen=True)
class Pose:
    """A camera's pose, as given and as moved since.

    Attributes:
        given: the camera that the scene names.
        middle: of the object, in the world.
        radius: of the object's bounding sphere, in world units, > 0.
        motion: in standard deviations; 0 is the pose that was given.
    """

    given: Camera
    middle: Float[Tensor, "3"]
    radius: float
    motion: Motion

    @staticmethod
    def of(camera: Camera, shape: Shape) -> Pose:
        """The pose as given."""
        middle, radius = bounding_sphere(shape)
        return Pose(camera, torch.as_tensor(middle).double(), radius, torch.zeros(6, dtype=torch.float64))

    @property
    def distance(self) -> float:
        """From the given camera to the middle of the object, in world units, > 0."""
        return max(float(self._towards_camera.norm()), 1e-9 * self.radius)

    @property
    def _towards_camera(self) -> Float[Tensor, "3"]:
        return self.given.camera_to_world[:3, 3] - self.middle

    @property
    def units(self) -> Motion:
        """Radians and world units that a number of `motion` stands for."""
        return torch.tensor([math.radians(DEGREES)] * 3 + [SHARE * self.distance] * 3, dtype=torch.float64)

    @property
    def camera(self) -> Camera:
        """The camera where it is now: camera_to_world · (exp [ω]×, t)."""
        turn, shift = (self.motion * self.units).split(3)
        motion = torch.eye(4, dtype=torch.float64)
        motion[:3, :3] = torch.linalg.matrix_exp(_cross(turn))
        motion[:3, 3] = shift
        return replace(self.given, camera_to_world=self.given.camera_to_world @ motion)

    def ways(self, angle: float) -> Float[Tensor, "6 6"]:
        """Six motions that separate shading from outlines: about the object's middle, aside in the picture, and nearer.

        Args:
            angle: how far, in radians; aside and nearer, the share of the object's radius by which its picture moves.
        """
        away = -self.given.camera_to_world[:3, :3].T @ self._towards_camera
        turned = torch.eye(3).double()
        about = torch.cat([turned, torch.linalg.cross(away.expand(3, 3), turned)], 1)
        aside = torch.cat([turned[:2] * self.radius / self.distance, torch.zeros(2, 3).double()], 1)
        nearer = torch.tensor([[0.0, 0, 0, 0, 0, self.distance]], dtype=torch.float64)
        return angle * torch.cat([about, aside, nearer]) / self.units

    def by(self, step: Motion) -> Pose:
        """The pose moved further."""
        return replace(self, motion=self.motion + step)

    @property
    def per_pixel(self) -> Motion:
        """How far each number alone has to go until the object's outline has moved by about a pixel."""
        pixel = _pixel_size(self.given, self.distance)
        turned, shifted = pixel / self.distance, pixel / self.radius
        world = [turned, turned, shifted, pixel, pixel, shifted * self.distance]
        return torch.tensor(world, dtype=torch.float64) / self.units

    @property
    def degrees(self) -> float:
        """The angle by which the camera was rotated."""
        return DEGREES * float(self.motion[:3].norm())

    @property
    def share(self) -> float:
        """The length by which it was shifted, over the distance."""
        return SHARE * float(self.motion[3:].norm())


def _cross(turn: Float[Tensor, "3"]) -> Float[Tensor, "3 3"]:
    """The matrix [ω]× of a cross product."""
    return torch.linalg.cross(turn.expand(3, 3), torch.eye(3, dtype=turn.dtype)).T


def _pixel_size(camera: Camera, distance: float) -> float:
    """The width of a pixel at a distance, in world units."""
    if camera.projection == "orthographic":
        return 2 * camera.scale / camera.width
    if camera.lens is not None:
        return distance / camera.lens.fx
    return distance * 2 * math.tan(math.radians(camera.fov) / 2) / camera.width
