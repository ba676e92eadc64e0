"""Where the viewer looks from, and how it moves: pure functions from one `Eye` to the next.

Angles instead of a matrix that is rotated again and again: nothing drifts, the horizon stays level, and straight up
and straight down are directions like any other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.opengl.geometry import Bounds

Vector = tuple[float, float, float]

STEEPEST = math.pi / 2
NEAREST, FARTHEST = 1e-3, 1e3  # distance from the target, in radii of the model
FRAME_MARGIN = 0.06


@dataclass(frozen=True)
class Eye:
    """A camera that can be moved.

    Attributes:
        target: the point that it turns round, in the middle of the picture.
        distance: from there, > 0.
        yaw: about +Y, radians; 0 looks along -Z.
        pitch: upwards, radians, in [-π/2, π/2].
        roll: about the direction of view, radians.
        projection, fov, scale: as a `Camera`'s.
    """

    target: Vector
    distance: float
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    projection: Literal["perspective", "orthographic"] = "perspective"
    fov: float = 35.0
    scale: float = 1.0

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Columns are right, up, backward: R_y(yaw) R_x(pitch) R_z(roll)."""
        return _about_y(self.yaw) @ _about_x(self.pitch) @ _about_z(self.roll)

    @property
    def origin(self) -> Float[np.ndarray, " 3"]:
        """The camera's position."""
        return np.array(self.target) + self.distance * self.rotation[:, 2]

    def camera(self, width: int, height: int) -> Camera:
        """The camera of a picture of `width` × `height` pixels."""
        matrix = torch.eye(4, dtype=torch.float64)
        matrix[:3, :3], matrix[:3, 3] = torch.from_numpy(self.rotation), torch.from_numpy(self.origin)
        return Camera(matrix, width, height, self.projection, self.fov, self.scale)


def eye_of(camera: Camera, target: Sequence[float] | Float[np.ndarray, " 3"]) -> Eye:
    """The eye that sees what `camera` sees, and turns round the point of its axis that is nearest to `target`.

    A target that lies behind the camera is taken as far away in front.
    """
    matrix = camera.camera_to_world.numpy()
    right, up, backward, origin = matrix[:3].T
    distance = abs(float((origin - target) @ backward)) or float(np.linalg.norm(origin - target)) or 1.0
    level = math.hypot(backward[0], backward[2])
    pitch = math.atan2(-backward[1], level)
    if level > 1e-9:
        yaw, roll = math.atan2(backward[0], backward[2]), math.atan2(right[1], up[1])
    else:  # straight up or down: yaw and roll turn about the same axis, and roll is nought
        yaw, roll = math.atan2(-right[2], right[0]), 0.0
    return Eye(
        _vector(origin - distance * backward), distance, yaw, pitch, roll, camera.projection, camera.fov, camera.scale
    )


def orbit(eye: Eye, yaw: float, pitch: float) -> Eye:
    """Turn round the target, at most until straight above or below it; angles in radians."""
    return replace(eye, yaw=_wrapped(eye.yaw + yaw), pitch=_steep(eye.pitch + pitch))


def look_round(eye: Eye, yaw: float, pitch: float) -> Eye:
    """Turn on the spot."""
    return _from_origin(orbit(eye, yaw, pitch), eye.origin)


def zoom(eye: Eye, factor: float, bounds: Bounds) -> Eye:
    """Go `factor` times as far away from the target; an orthographic picture takes in `factor` times as much."""
    distance = _within(eye.distance * factor, NEAREST * bounds.radius, FARTHEST * bounds.radius)
    return replace(eye, distance=distance, scale=eye.scale * distance / eye.distance)


def pan(eye: Eye, right: float, up: float) -> Eye:
    """Shift the picture's plane through the target by shares of half the picture's width."""
    half_width = eye.scale if eye.projection == "orthographic" else eye.distance * _tan_half(eye)
    return _shifted(eye, half_width * (right * eye.rotation[:, 0] + up * eye.rotation[:, 1]))


def walk(eye: Eye, right: float, up: float, forward: float) -> Eye:
    """Move by world units: `up` along +Y, the others along the picture's own axes."""
    step = right * eye.rotation[:, 0] - forward * eye.rotation[:, 2]
    return _shifted(eye, step + np.array([0.0, up, 0.0]))


def frame(eye: Eye, bounds: Bounds, aspect: float) -> Eye:
    """See the whole model, level, from the side that the eye is on.

    Args:
        aspect: the picture's width over its height.
    """
    narrow = max(1.0, aspect)  # the angle of view is that of the width; a wide picture's height sees less
    half_angle = math.atan(_tan_half(eye) / narrow)
    distance = (1 + FRAME_MARGIN) * bounds.radius / math.sin(half_angle)
    scale = (1 + FRAME_MARGIN) * bounds.radius * narrow
    return replace(eye, target=_vector(bounds.centre), distance=distance, roll=0.0, scale=scale)


def _from_origin(eye: Eye, origin: Float[np.ndarray, " 3"]) -> Eye:
    return replace(eye, target=_vector(origin - eye.distance * eye.rotation[:, 2]))


def _shifted(eye: Eye, step: Float[np.ndarray, " 3"]) -> Eye:
    return replace(eye, target=_vector(np.array(eye.target) + step))


def _tan_half(eye: Eye) -> float:
    return math.tan(math.radians(eye.fov) / 2)


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)


def _steep(pitch: float) -> float:
    return _within(pitch, -STEEPEST, STEEPEST)


def _within(value: float, low: float, high: float) -> float:
    return max(low, min(high, value))


def _vector(array: Float[np.ndarray, " 3"]) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


def _about_x(angle: float) -> Float[np.ndarray, "3 3"]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _about_y(angle: float) -> Float[np.ndarray, "3 3"]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _about_z(angle: float) -> Float[np.ndarray, "3 3"]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
