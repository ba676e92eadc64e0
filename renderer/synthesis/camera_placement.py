"""Where synthetic photographs are taken from: cameras all round an object."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.geometry.bounds import Vector, bounding_sphere
from fit_material.renderer.geometry.mesh import Shape


@dataclass(frozen=True)
class View:
    """A camera as in scene.toml: positions in world units, `fov` the horizontal angle in degrees."""

    origin: Vector
    target: Vector
    up: Vector
    fov: float

    def camera(self, size: int) -> Camera:
        """The camera of a square photograph, `size` pixels wide."""
        pose = look_at(*(torch.tensor(v, dtype=torch.float64) for v in (self.origin, self.target, self.up)))
        return Camera(pose, size, size, fov=self.fov)


def views(count: int, shape: Shape, fov: float = 35.0, margin: float = 0.06) -> list[View]:
    """Cameras all round an object, each at a height of its own, that see the whole of it.

    Args:
        count: how many; their azimuths are evenly spaced.
        shape: what to look at; its bounding sphere fills the frame but for the margin.
        fov: full horizontal angle of view, degrees.
        margin: how much farther away than necessary to stand, as a fraction.
    """
    target, radius = bounding_sphere(shape)
    distance = (1 + margin) * radius / math.sin(math.radians(fov) / 2)
    return [_view(index, count, target, distance, fov) for index in range(count)]


def _view(index: int, count: int, target: Float[np.ndarray, " 3"], distance: float, fov: float) -> View:
    """Even steps round +Y; the golden ratio spreads the elevations evenly over -20° to 50°, for any count."""
    golden = (math.sqrt(5) - 1) / 2
    azimuth = math.radians(25 + 360 * index / count)
    elevation = math.radians(-20 + 70 * ((0.5 + golden * index) % 1))
    level = math.cos(elevation)
    towards = np.array([level * math.sin(azimuth), math.sin(elevation), level * math.cos(azimuth)])
    origin = target + distance * towards
    return View(_vector(origin), _vector(target), (0.0, 1.0, 0.0), fov)


def _vector(array: Float[np.ndarray, " 3"]) -> Vector:
    x, y, z = array.tolist()
    return x, y, z
