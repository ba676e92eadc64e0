"""A mesh as OpenGL takes it: one buffer of vertices, and the triangles of each object and material."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import moderngl
import numpy as np
from jaxtyping import Float, Int

from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.geometry.tangents import tangents

# name, floats and place of each attribute in a vertex
_LAYOUT = (("position", 3), ("normal", 3), ("uv", 2), ("tangent", 4))


@dataclass(frozen=True)
class Bounds:
    """A bounding box: its centre, and half its diagonal, the radius of a sphere around it."""

    centre: Float[np.ndarray, " 3"]
    radius: float


@dataclass(frozen=True)
class Group:
    """Triangles of one object and one material.

    Attributes:
        part, material: indices into the mesh's objects and materials.
        indices: buffer of vertex indices, uint32.
    """

    part: int
    material: int
    indices: moderngl.Buffer


class Geometry:
    """A mesh in the graphics memory.

    Attributes:
        bounds: of the whole mesh. Vertices are relative to its centre, which keeps float32's digits.
        has_uv, has_tangents: whether the mesh has texture coordinates, and tangents besides.
        groups: its triangles.
    """

    def __init__(self, context: moderngl.Context, mesh: Mesh) -> None:
        self._context = context
        self.bounds = bounds(mesh.vertices[np.unique(mesh.faces)])
        tangent = tangents(mesh)
        self.has_uv, self.has_tangents = mesh.uv is not None, tangent is not None
        vertices, faces = _vertices(mesh, tangent, self.bounds.centre)
        self._vertices = context.buffer(vertices.astype(np.float32).tobytes())
        self._positions = context.buffer(np.ascontiguousarray(vertices[:, :3]).tobytes())
        self.groups = tuple(_groups(context, mesh, faces))

    def vertex_array(self, group: Group, program: moderngl.Program) -> moderngl.VertexArray:
        """A group's triangles as a program's attributes."""
        used = [(name, count) if name in program else ("", count) for name, count in _LAYOUT]
        layout = " ".join(f"{count}f" if name else f"{4 * count}x" for name, count in used)
        names = [name for name, _ in used if name]
        return self._context.vertex_array(program, [(self._vertices, layout, *names)], index_buffer=group.indices)

    def bind_exact(self, group: Group) -> None:
        """Let the shader's EXACT variant read a group's corners; its attributes.glsl has the same numbers."""
        for binding, buffer in enumerate((self._positions, self._vertices, group.indices)):
            buffer.bind_to_storage_buffer(binding)

    def release(self) -> None:
        """Give the memory back."""
        for buffer in (self._vertices, self._positions, *(group.indices for group in self.groups)):
            buffer.release()


def bounds(vertices: Float[np.ndarray, "v 3"]) -> Bounds:
    """The bounding box of at least one vertex."""
    lowest, highest = vertices.min(0), vertices.max(0)
    return Bounds((lowest + highest) / 2, float(np.linalg.norm(highest - lowest)) / 2)


def _vertices(
    mesh: Mesh, tangent: Float[np.ndarray, "v 4"] | None, centre: Float[np.ndarray, " 3"]
) -> tuple[Float[np.ndarray, "w 12"], Int[np.ndarray, "f 3"]]:
    """Attributes side by side, and the faces' indices; a faceted mesh's corners are vertices of their own."""
    positions = mesh.vertices - centre
    uv = np.zeros((len(positions), 2)) if mesh.uv is None else mesh.uv
    tangent = np.zeros((len(positions), 4)) if tangent is None else tangent
    if mesh.normals is not None:
        return np.concatenate([positions, mesh.normals, uv, tangent], 1), mesh.faces
    corner = positions[mesh.faces]
    normals = np.repeat(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), 3, axis=0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)  # of triangles without area there are none
    own = mesh.faces.reshape(-1)
    vertices = np.concatenate([corner.reshape(-1, 3), normals, uv[own], tangent[own]], 1)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def _groups(context: moderngl.Context, mesh: Mesh, faces: Int[np.ndarray, "f 3"]) -> Iterator[Group]:
    part = np.zeros(len(faces), np.int64) if mesh.part is None else mesh.part
    for p, m in np.unique(np.stack([part, mesh.material], 1), axis=0).tolist():
        chosen = faces[(part == p) & (mesh.material == m)]
        yield Group(p, m, context.buffer(chosen.astype(np.uint32).tobytes()))
