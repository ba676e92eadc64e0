"""What is around each reflective object: cubemaps of the other objects and the environment, with depth.

They are drawn from the centre of the object's bounding box; the objects in them mirror the far environment only.
Twin of renderer/viewer_model/captured_neighbours.py. [thesis 3.1.1, 3.1.3; MODEL.md 2, 3.3]
"""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from fit_material.renderer.environment.cubemap import FACES
from fit_material.renderer.opengl.geometry import Bounds, bounds
from fit_material.renderer.opengl.painting import Painter, Pass
from fit_material.renderer.opengl.targets import linear_target, release_target
from fit_material.renderer.opengl.view import face_view
from fit_material.renderer.viewer_model.model import Model
from fit_material.renderer.viewer_model.shading import reflective_parts
from fit_material.renderer.viewer_model.viewer_light import VIEWER_FACE_SIZE


class Captures:
    """The captured cubemaps of a model's objects, kept until the environment turns.

    Args:
        objects: the bounds of each object that is to have one, by its index; see `capturing_objects`.
        size: texels along a face's side.
    """

    def __init__(
        self,
        context: moderngl.Context,
        painter: Painter,
        objects: Mapping[int, Bounds],
        size: int = VIEWER_FACE_SIZE,
    ) -> None:
        self._context, self._painter, self._objects, self._size = context, painter, objects, size
        self._rotation: float | None = None
        self._textures = {part: _empty_cubemap(context, size) for part in objects}

    def at(self, rotation: float) -> Mapping[int, moderngl.TextureCube]:
        """The cubemaps by object, radiance and depth, under an environment rotated by `rotation` degrees."""
        if self._objects and rotation != self._rotation:
            self._render(rotation)
            self._rotation = rotation
        return self._textures

    def release(self) -> None:
        """Give the memory back."""
        for texture in self._textures.values():
            texture.release()

    def _render(self, rotation: float) -> None:
        """Face by face into one target, whose lowest row is a face's first."""
        target = linear_target(self._context, (self._size, self._size))
        pixels = self._context.buffer(reserve=4 * 4 * self._size**2)
        for part, within in self._objects.items():
            for face in range(len(FACES)):
                view = face_view(face, within.centre, self._size, self._painter.geometry.bounds)
                self._painter.paint(target, Pass(view, rotation, without=part, near=within.radius))
                target.read_into(pixels, components=4, dtype="f4")
                self._textures[part].write(face, pixels)
        pixels.release()
        release_target(target)


def capturing_objects(model: Model) -> dict[int, Bounds]:
    """Bounds of the objects that mirror others: those with a metal or glossy material, where there are several."""
    mesh = model.mesh
    if mesh.part is None or len(np.unique(mesh.part)) < 2:
        return {}
    mirrors = reflective_parts(mesh, model.appearances)
    return {part: bounds(mesh.vertices[np.unique(mesh.faces[mesh.part == part])]) for part in mirrors}


def _empty_cubemap(context: moderngl.Context, size: int) -> moderngl.TextureCube:
    texture = context.texture_cube((size, size), 4, dtype="f4")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    return texture
