"""Tangents of a mesh: which way the texture coordinate u grows, for normal maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from fit_material.renderer.geometry.mesh import Mesh

CANCELLED = 1e-9  # a mean of unit vectors that is shorter is rounding


def tangents(mesh: Mesh) -> Float[np.ndarray, "v 4"] | None:
    """Unit tangents along growing u, and the handedness of the bitangent, for `shaders.normal_map.perturbed`.

        ∂P/∂u = (Δv₂ e₁ - Δv₁ e₂)/d,   ∂P/∂v = (Δu₁ e₂ - Δu₂ e₁)/d,   d = Δu₁ Δv₂ - Δu₂ Δv₁

    per triangle with edges e₁, e₂ [Lengyel 2019, Foundations of Game Engine Development 2, §7.5]. At a vertex the
    unit vectors of its triangles are summed, weighted by area, and made perpendicular to the vertex normal.

    Returns:
        x, y, z of the tangent and w = ±1, so that v grows along w · (normal × tangent); None where the mesh has no
        texture coordinates or no vertex normals. Where the coordinates determine no direction, as in triangles that
        are one point of the texture, the tangent is any that is perpendicular to the normal.
    """
    if mesh.uv is None or mesh.normals is None:
        return None
    u_axis, v_axis = (_mean_at_vertices(mesh, axis) for axis in _texture_axes(mesh))
    normal = mesh.normals
    across = u_axis - _dot(u_axis, normal) * normal
    along = np.where(_dot(across, across) > CANCELLED**2, _unit(across), _any_perpendicular(normal))
    handedness = np.where(_dot(np.cross(normal, along), v_axis) < 0, -1.0, 1.0)
    return np.concatenate([along, handedness], -1)


def with_mirrored_apart(mesh: Mesh) -> Mesh:
    """The mesh with vertices doubled where a texture meets its mirror image, whose tangents would cancel there."""
    if mesh.uv is None:
        return mesh
    mirrored = _uv_area(mesh) < 0
    kinds, faces = np.unique(2 * mesh.faces + mirrored[:, None], return_inverse=True)
    vertex = kinds // 2
    normals = None if mesh.normals is None else mesh.normals[vertex]
    faces = faces.reshape(mesh.faces.shape)
    return replace(mesh, vertices=mesh.vertices[vertex], faces=faces, normals=normals, uv=mesh.uv[vertex])


def _texture_axes(mesh: Mesh) -> tuple[Float[np.ndarray, "f 3"], Float[np.ndarray, "f 3"]]:
    """Unit vectors along which u and v grow in each triangle; 0 where its coordinates span no area."""
    e1, e2 = _edges(mesh.vertices[mesh.faces])
    d1, d2 = _edges(_uv(mesh)[mesh.faces])
    sign = np.sign(_uv_area(mesh))[:, None]
    u_axis = d2[:, 1:] * e1 - d1[:, 1:] * e2
    v_axis = d1[:, :1] * e2 - d2[:, :1] * e1
    return sign * _unit(u_axis), sign * _unit(v_axis)


def _uv_area(mesh: Mesh) -> Float[np.ndarray, " f"]:
    """Twice each triangle's area in the texture, negative where it is mirrored, 0 where it is only rounding."""
    d1, d2 = _edges(_uv(mesh)[mesh.faces])
    area = d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]
    rounding = 1e-12 * np.linalg.norm(d1, axis=-1) * np.linalg.norm(d2, axis=-1)
    return np.where(np.abs(area) > rounding, area, 0.0)


def _uv(mesh: Mesh) -> Float[np.ndarray, "v 2"]:
    assert mesh.uv is not None
    return mesh.uv


def _edges(corner: Float[np.ndarray, "f 3 c"]) -> tuple[Float[np.ndarray, "f c"], Float[np.ndarray, "f c"]]:
    return corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]


def _mean_at_vertices(mesh: Mesh, per_face: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "v 3"]:
    """The mean over the triangles around each vertex, weighted by their area."""
    area = np.linalg.norm(np.cross(*_edges(mesh.vertices[mesh.faces])), axis=-1, keepdims=True)
    total = np.zeros((len(mesh.vertices), 4))
    np.add.at(total, mesh.faces, np.concatenate([area * per_face, area], -1)[:, None])
    return np.divide(total[:, :3], total[:, 3:], out=np.zeros_like(mesh.vertices), where=total[:, 3:] > 0)


def _any_perpendicular(normal: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
    """A unit vector perpendicular to each normal, from the axis that is farthest from it."""
    axis = np.eye(3)[np.abs(normal).argmin(-1)]
    return _unit(np.cross(normal, axis))


def _dot(a: Float[np.ndarray, "v 3"], b: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 1"]:
    return (a * b).sum(-1, keepdims=True)


def _unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Vectors of unit length; 0 stays 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
