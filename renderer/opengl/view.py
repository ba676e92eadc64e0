"""From cameras to what OpenGL needs: matrices to clip space and the direction in which each pixel looks; float64."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment.cubemap import AXES
from fit_material.renderer.opengl.geometry import Bounds

_NEAREST = 1e-3  # of the scene's radius: closer things are cut off, for the depth buffer's sake

Vector = Float[np.ndarray, " 3"]


@dataclass(frozen=True)
class View:
    """How the world falls onto a framebuffer.

    Attributes:
        eye: the camera's position.
        to_clip: from world to clip space.
        film_direction: what one pixel to the right, one pixel upwards, and the framebuffer's lower left corner (the
            columns) add to the unnormalised direction of a pixel's ray.
        film_origin: likewise of its origin.
    """

    eye: Vector
    to_clip: Float[np.ndarray, "4 4"]
    film_direction: Float[np.ndarray, "3 3"]
    film_origin: Float[np.ndarray, "3 3"]

    def told_from(self, centre: Vector) -> View:
        """The same view of positions relative to `centre`."""
        placed = np.eye(4)
        placed[:3, 3] = centre
        origin = self.film_origin - np.outer(centre, [0, 0, 1])
        return View(self.eye - centre, self.to_clip @ placed, self.film_direction, origin)


@dataclass(frozen=True)
class _Film:
    """Axes of a camera; `right` and `up` reach from the film's centre to its edges, at distance 1 for a perspective."""

    eye: Vector
    right: Vector
    up: Vector
    forward: Vector
    orthographic: bool = False


def camera_view(
    camera: Camera, size: tuple[int, int], bounds: Bounds, offset: tuple[float, float] = (0.0, 0.0)
) -> View:
    """The view of a camera.

    Args:
        camera: whose film is spread over the whole framebuffer.
        size: width and height of the framebuffer in pixels.
        bounds: of the visible part; depth is resolved within.
        offset: by which each pixel is sampled off its centre, rightwards and upwards, in pixels.
    """
    right, up, backward, eye = camera.camera_to_world[:3].double().numpy().T
    orthographic = camera.projection == "orthographic"
    half_width = camera.scale if orthographic else math.tan(math.radians(camera.fov) / 2)
    half_height = half_width * camera.height / camera.width
    return _view(_Film(eye, half_width * right, half_height * up, -backward, orthographic), size, bounds, offset)


def face_view(face: int, eye: Vector, size: int, bounds: Bounds) -> View:
    """The view from `eye` through one face of a cubemap, whose first row is the framebuffer's lowest."""
    right, down, outward = AXES[face].numpy()
    return _view(_Film(eye, right, down, outward), (size, size), bounds, (0.0, 0.0))


def _view(film: _Film, size: tuple[int, int], bounds: Bounds, offset: tuple[float, float]) -> View:
    width, height = size
    right, up = 2 * film.right / width, 2 * film.up / height
    corner = offset[0] * right + offset[1] * up - film.right - film.up
    spread, same = np.stack([right, up, corner], 1), np.zeros((3, 3))
    direction, origin = (same, spread) if film.orthographic else (spread, same)
    shift = np.array([2 * offset[0] / width, 2 * offset[1] / height])
    corner_only = [0, 0, 1]
    return View(
        eye=film.eye,
        to_clip=_to_clip(film, bounds, shift),
        film_direction=direction + np.outer(film.forward, corner_only),
        film_origin=origin + np.outer(film.eye, corner_only),
    )


def _to_clip(film: _Film, bounds: Bounds, shift: Float[np.ndarray, " 2"]) -> Float[np.ndarray, "4 4"]:
    """OpenGL's projection, with rows for x, y, z, w; what lies at `shift` comes to the middle."""
    near, far = _depth_range(film, bounds)
    rows = np.zeros((4, 4))
    rows[0, :3] = film.right / (film.right @ film.right)
    rows[1, :3] = film.up / (film.up @ film.up)
    if film.orthographic:
        rows[2, :3], rows[2, 3] = 2 * film.forward / (far - near), -(far + near) / (far - near)
        rows[3, 3] = 1
    else:
        rows[2, :3], rows[2, 3] = (far + near) / (far - near) * film.forward, -2 * far * near / (far - near)
        rows[3, :3] = film.forward
    rows[:2] -= shift[:, None] * rows[3]
    towards_eye = np.eye(4)
    towards_eye[:3, 3] = -film.eye
    return rows @ towards_eye


def _depth_range(film: _Film, bounds: Bounds) -> tuple[float, float]:
    """Distances along the view between which the scene lies, in front of the camera."""
    middle = float((bounds.centre - film.eye) @ film.forward)
    reach = 1.001 * bounds.radius
    nearest = 0.0 if film.orthographic else _NEAREST * bounds.radius
    near = max(middle - reach, nearest)
    return near, max(middle + reach, near + reach)
