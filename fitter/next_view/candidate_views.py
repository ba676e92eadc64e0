"""Where a further photograph might be taken from: cameras all round an object, like those that there are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.geometry.bounds import Vector, bounding_sphere
from fit_material.renderer.geometry.mesh import Shape
from fit_material.renderer.scene.scene_file import CameraSpec, camera_of

DIRECTIONS = 96  # 21° from each to the next: the information of views changes more slowly than that
CLOSER = 48  # the same from nearer by, where the object leaves much of the frame empty
TOO_NEAR = 5.0  # degrees: such a view would be one of those that there are
MARGIN = 0.06  # how much farther than necessary a camera stands that has the object fill its frame
WORTH_COMING = 0.75  # of the distance: else there is nothing to be gained by coming closer
BEARINGS = ("right", "upper right", "top", "upper left", "left", "lower left", "bottom", "lower right")


@dataclass(frozen=True)
class Viewpoint:
    """A camera that could be.

    Attributes:
        spec: as the scene file would have it.
        camera: the same, with a picture's size.
        nearest: index of the photograph taken from the nearest direction.
        angle: degrees between that direction and this one, as seen from the object.
        bearing: where to from that photograph, on its picture; one of `BEARINGS`.
    """

    spec: CameraSpec
    camera: Camera
    nearest: int
    angle: float
    bearing: str


def viewpoints(cameras: Sequence[Camera], specs: Sequence[CameraSpec], shape: Shape) -> list[Viewpoint]:
    """Cameras all round the middle of an object: projection, field of view, size and distance of a typical photograph.

    Where the object would leave much of the frame empty, there are some that stand closer, too.

    Args:
        cameras: of the photographs, at least one.
        specs: the same in the scene file's words.
        shape: the object.

    Returns:
        the cameras, without those from where there is a photograph already, unless there is one everywhere.
    """
    middle, radius = bounding_sphere(shape)
    centre = torch.from_numpy(middle)
    typical = sorted(range(len(cameras)), key=lambda i: _distance(cameras[i], centre))[len(cameras) // 2]
    up = _up(cameras, specs)
    existing = torch.stack([_towards(camera, centre) for camera in cameras])
    found = []
    for count, distance in _distances(cameras[typical], centre, radius):
        for direction in lattice(count, up):
            origin = centre + distance * direction
            spec = _spec(origin, centre, up, cameras[typical])
            nearest = int((existing @ direction).argmax())
            angle = angle_between(existing[nearest], direction)
            camera = camera_of(spec, cameras[typical].width, cameras[typical].height)
            bearing = _bearing(cameras[nearest], direction - existing[nearest])
            found.append(Viewpoint(spec, camera, nearest, angle, bearing))
    return [viewpoint for viewpoint in found if viewpoint.angle >= TOO_NEAR] or found


def lattice(count: int, up: Float[Tensor, "3"]) -> Float[Tensor, "c 3"]:
    """Unit vectors spread evenly over the sphere, none of them along `up`: a Fibonacci lattice.

    Equal steps along the axis, the golden angle about it [González 2010, "Measurement of areas on a sphere using
    Fibonacci and latitude–longitude lattices", eq. 1].
    """
    index = torch.arange(count, dtype=torch.float64)
    along = 1 - (2 * index + 1) / count
    turn = index * math.pi * (3 - math.sqrt(5))
    around = (1 - along**2).sqrt()
    axis = torch.nn.functional.one_hot(up.abs().argmin(), 3).to(up)
    first = torch.nn.functional.normalize(torch.linalg.cross(up, axis), dim=0)
    second = torch.linalg.cross(up, first)
    return torch.stack([around * turn.cos(), around * turn.sin(), along], 1) @ torch.stack([first, second, up])


def angle_between(a: Float[Tensor, "3"], b: Float[Tensor, "3"]) -> float:
    """Degrees between two unit vectors; by atan2, which keeps its digits near 0° and 180°."""
    return math.degrees(torch.atan2(torch.linalg.cross(a, b).norm(), a @ b))


def _distance(camera: Camera, centre: Float[Tensor, "3"]) -> float:
    return float((camera.camera_to_world[:3, 3] - centre).norm())


def _towards(camera: Camera, centre: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """The direction from the object to the camera."""
    if camera.projection == "orthographic":
        return camera.camera_to_world[:3, 2]
    return torch.nn.functional.normalize(camera.camera_to_world[:3, 3] - centre, dim=0)


def _up(cameras: Sequence[Camera], specs: Sequence[CameraSpec]) -> Float[Tensor, "3"]:
    """What is upwards in the scene: the first camera's word, or where poses are matrices, upwards in the pictures."""
    if specs[0].matrix is None:
        return torch.nn.functional.normalize(torch.tensor(specs[0].up, dtype=torch.float64), dim=0)
    mean = torch.stack([camera.camera_to_world[:3, 1] for camera in cameras]).mean(0)
    return torch.nn.functional.normalize(mean if mean.norm() > 0.1 else cameras[0].camera_to_world[:3, 1], dim=0)


def _distances(camera: Camera, centre: Float[Tensor, "3"], radius: float) -> list[tuple[int, float]]:
    """How many cameras at which distances from the middle."""
    given = _distance(camera, centre)
    if camera.projection == "orthographic":
        return [(DIRECTIONS, max(given, 2 * radius))]
    tan_half = math.tan(math.radians(camera.fov / 2)) * min(1.0, camera.height / camera.width)
    filling = (1 + MARGIN) * radius / math.sin(math.atan(tan_half))
    # nearer than the object's own sphere, other directions might lie inside of it
    distances = [(DIRECTIONS, max(given, (1 + MARGIN) * radius))]
    return [*distances, (CLOSER, filling)] if filling < WORTH_COMING * given else distances


def _spec(origin: Float[Tensor, "3"], target: Float[Tensor, "3"], up: Float[Tensor, "3"], like: Camera) -> CameraSpec:
    """A camera of the scene file; rounded to what a person would type, a thousandth of its distance."""
    digits = max(0, 3 - math.floor(math.log10(float((origin - target).norm()))))

    def rounded(vector: Float[Tensor, "3"], places: int) -> Vector:
        x, y, z = (round(value, places) + 0.0 for value in vector.tolist())  # + 0.0: no -0.0
        return x, y, z

    data = {
        "origin": rounded(origin, digits),
        "target": rounded(target, digits),
        "up": rounded(up, 4),
        "fov": like.fov,
        "projection": like.projection,
    }
    return CameraSpec.model_validate(data | ({"scale": like.scale} if like.projection == "orthographic" else {}))


def _bearing(camera: Camera, step: Float[Tensor, "3"]) -> str:
    """Where a step leads to on a camera's picture."""
    right, up = float(camera.camera_to_world[:3, 0] @ step), float(camera.camera_to_world[:3, 1] @ step)
    return BEARINGS[round(math.degrees(math.atan2(up, right)) / 45) % 8]
