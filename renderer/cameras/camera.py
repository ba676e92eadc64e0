"""Cameras: where each pixel looks from, and in which direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.cameras.lens import Lens


@dataclass(frozen=True)
class Camera:
    """A pinhole or orthographic camera in OpenGL's convention: +X right, +Y up, looking along -Z.

    Attributes:
        camera_to_world: rigid motion, float64 [4, 4]; columns are right, up, backward, origin.
        width, height: size of the photograph in pixels.
        projection: "perspective" or "orthographic".
        fov: full horizontal angle of view in degrees (perspective).
        scale: half the horizontal extent in world units (orthographic).
        lens: what takes the place of `fov` for rays where the camera is no centred pinhole (perspective).
    """

    camera_to_world: Float[Tensor, "4 4"]
    width: int
    height: int
    projection: Literal["perspective", "orthographic"] = "perspective"
    fov: float = 35.0
    scale: float = 1.0
    lens: Lens | None = None

    def rays(
        self, x: Float[Tensor, "*p"], y: Float[Tensor, "*p"]
    ) -> tuple[Float[Tensor, "*p 3"], Float[Tensor, "*p 3"]]:
        """Rays through film positions.

        Args:
            x, y: position on the film in pixels, (0, 0) the upper left corner of the upper left pixel,
                so that pixel (i, j) has its centre at (i + 0.5, j + 0.5).

        Returns:
            origins and unit directions in world space, float64.
        """
        rotation, position = self.camera_to_world[:3, :3], self.camera_to_world[:3, 3]
        if self.lens is not None:
            right, down = self.lens.plane(x, y)
            return _through(position, torch.stack([right, -down, -torch.ones_like(right)], -1), rotation)
        half_width = self.width / 2
        right = (x.double() - half_width) / half_width
        up = (self.height / 2 - y.double()) / half_width
        if self.projection == "orthographic":
            offset = torch.stack([right * self.scale, up * self.scale, torch.zeros_like(right)], -1)
            direction = (-rotation[:, 2]).expand(offset.shape)
            return position + offset @ rotation.T, direction
        tan_half = torch.tan(torch.deg2rad(torch.tensor(self.fov / 2, dtype=torch.float64)))
        return _through(position, torch.stack([right * tan_half, up * tan_half, -torch.ones_like(right)], -1), rotation)

    def film(
        self, points: Float[Tensor, "*p 3"]
    ) -> tuple[Float[Tensor, "*p"], Float[Tensor, "*p"], Float[Tensor, "*p"]]:
        """Where points of the world are on the film: the inverse of `rays`.

        Returns:
            x and y as `rays` takes them, and the distance along the camera's axis, > 0 before it; x and y of points
            that are not before a perspective camera mean nothing.
        """
        rotation, position = self.camera_to_world[:3, :3], self.camera_to_world[:3, 3]
        right, up, backward = ((points.double() - position) @ rotation).unbind(-1)
        if self.projection == "orthographic":
            right, up = right / self.scale, up / self.scale
        else:
            right, up = right / -backward, up / -backward
            if self.lens is not None:
                right, down = self.lens.distorted(right, -up)
                return right * self.lens.fx + self.lens.cx, down * self.lens.fy + self.lens.cy, -backward
            tan_half = torch.tan(torch.deg2rad(torch.tensor(self.fov / 2, dtype=torch.float64)))
            right, up = right / tan_half, up / tan_half
        half_width = self.width / 2
        return half_width * (1 + right), self.height / 2 - half_width * up, -backward


def _through(
    position: Float[Tensor, "3"], point: Float[Tensor, "*p 3"], rotation: Float[Tensor, "3 3"]
) -> tuple[Float[Tensor, "*p 3"], Float[Tensor, "*p 3"]]:
    """Rays from one position through points that are given in the camera's axes."""
    direction = torch.nn.functional.normalize(point, dim=-1) @ rotation.T
    return position.expand(direction.shape), direction


def look_at(origin: Float[Tensor, "3"], target: Float[Tensor, "3"], up: Float[Tensor, "3"]) -> Float[Tensor, "4 4"]:
    """Camera-to-world matrix of a camera at `origin` that looks at `target`.

    Args:
        origin, target: world positions; must differ.
        up: world direction that shall point upwards in the picture; must not be parallel to the view.

    Returns:
        float64 [4, 4]; columns are right, up, backward, origin.

    Raises:
        ValueError: where origin and target coincide, or up is parallel to the view.
    """
    origin, target, up = (v.double() for v in (origin, target, up))
    backward = origin - target
    right = torch.linalg.cross(up, backward)
    if right.norm() <= 1e-9 * up.norm() * backward.norm() or backward.norm() == 0:
        raise ValueError("origin, target and up do not span a camera: they coincide or are parallel")
    backward, right = backward / backward.norm(), right / right.norm()
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, 0], matrix[:3, 1] = right, torch.linalg.cross(backward, right)
    matrix[:3, 2], matrix[:3, 3] = backward, origin
    return matrix
