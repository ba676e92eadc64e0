"""Which triangle each ray meets first, by Mitsuba, and where on it."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.backends.mitsuba_library import mitsuba_library
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Shape
from fit_material.renderer.mitsuba import conversion


class Caster(Protocol):
    """The index of the face that each ray meets first, -1 for none.

    Args:
        origins, directions: of the rays; directions are unit.
        length: of each ray, beyond which nothing is met; no end where left out.
    """

    def __call__(
        self,
        origins: Float[Tensor, "p 3"],
        directions: Float[Tensor, "p 3"],
        length: Float[Tensor, " p"] | None = None,
        /,
    ) -> Int[np.ndarray, " p"]: ...


def caster(shape: Shape) -> Caster:
    """The caster of a shape.

    All rays at once through LLVM where its library is found, else one by one, which takes thirty times as long.
    Mitsuba's current variant is afterwards what it was.
    """
    mi = mitsuba_library()
    before = mi.variant()
    try:
        return _vectorised(shape, conversion.mitsuba("llvm_ad_rgb"))
    except InputError:  # no LLVM here
        return _one_by_one(shape, conversion.mitsuba("scalar_rgb"))
    finally:
        if before is not None:
            mi.set_variant(before)


def _vectorised(shape: Shape, mi: Any) -> Caster:
    scene = _scene(shape, mi)
    # of this variant, whatever is current later
    ray_type, point, vector, number = mi.Ray3f, mi.Point3f, mi.Vector3f, mi.Float

    def cast(
        origins: Float[Tensor, "p 3"], directions: Float[Tensor, "p 3"], length: Float[Tensor, " p"] | None = None, /
    ) -> Int[np.ndarray, " p"]:
        if not len(origins):
            return np.empty(0, np.int64)
        rays = ray_type(point(_columns(origins)), vector(_columns(directions)))
        if length is not None:
            rays.maxt = number(length.numpy().astype(np.float32))
        found = scene.ray_intersect_preliminary(rays, coherent=False)
        return np.where(np.array(found.is_valid()), np.array(found.prim_index).astype(np.int64), -1)

    return cast


def _one_by_one(shape: Shape, mi: Any) -> Caster:
    scene, ray_type = _scene(shape, mi), mi.Ray3f

    def cast(
        origins: Float[Tensor, "p 3"], directions: Float[Tensor, "p 3"], length: Float[Tensor, " p"] | None = None, /
    ) -> Int[np.ndarray, " p"]:
        rays = map(ray_type, origins.tolist(), directions.tolist())
        if length is not None:
            rays = map(_ended, rays, length.tolist())
        found = map(scene.ray_intersect_preliminary, rays)
        return np.array([each.prim_index if each.is_valid() else -1 for each in found], np.int64)

    return cast


def _ended(ray: Any, length: float) -> Any:
    ray.maxt = length
    return ray


def _scene(shape: Shape, mi: Any) -> Any:
    return mi.load_dict({"type": "scene", "object": conversion.mitsuba_shape(shape)})


def _columns(vectors: Float[Tensor, "p 3"]) -> Float[np.ndarray, "3 p"]:
    return np.ascontiguousarray(vectors.numpy().T, np.float32)


def barycentric(
    corner: Float[np.ndarray, "p 3 3"], origins: Float[np.ndarray, "p 3"], directions: Float[np.ndarray, "p 3"]
) -> Float[np.ndarray, "p 3"]:
    """Weights of the three corners where a ray meets their plane [Möller & Trumbore 1997, eq. 6], float64.

    Mitsuba's own weights are float32, whose rounding shows in mirrors. A ray inside the plane gets the centroid.
    """
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    across, offset = np.cross(directions, second), origins - corner[:, 0]
    determinant = (across * first).sum(-1)
    parallel = determinant == 0
    determinant = np.where(parallel, 1.0, determinant)
    u = (across * offset).sum(-1) / determinant
    v = (np.cross(offset, first) * directions).sum(-1) / determinant
    return np.where(parallel[:, None], 1 / 3, np.stack([1 - u - v, u, v], -1))
