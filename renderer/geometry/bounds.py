"""Bounding spheres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from fit_material.renderer.geometry.mesh import Shape, Sphere

Vector = tuple[float, float, float]


def bounding_sphere(shape: Shape) -> tuple[Float[np.ndarray, " 3"], float]:
    """A sphere round the middle of the bounding box that contains every corner of every face."""
    if isinstance(shape, Sphere):
        return np.zeros(3), 1.0
    corners = shape.vertices[np.unique(shape.faces)]
    middle = (corners.min(0) + corners.max(0)) / 2
    return middle, float(np.linalg.norm(corners - middle, axis=1).max())
