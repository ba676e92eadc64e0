"""Shapes: triangle meshes read through trimesh, and the analytic unit sphere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Sphere:
    """The analytic unit sphere at the origin: exact normals, no facets."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in world space, +Y up.

    Attributes:
        vertices: positions, float64.
        faces: three vertex indices per triangle, counter-clockwise from outside.
        normals: unit vertex normals for smooth shading, or None where the mesh is to be shaded by its facets.
        uv: texture coordinates per vertex, or None.
        material: index into `material_names` per face.
        material_names: the `usemtl` names; one entry, "default", where the file names none.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normals: Float[np.ndarray, "v 3"] | None
    uv: Float[np.ndarray, "v 2"] | None
    material: Int[np.ndarray, " f"]
    material_names: tuple[str, ...] = ("default",)


Shape = Sphere | Mesh
