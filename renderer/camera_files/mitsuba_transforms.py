"""The transforms of a Mitsuba scene file, in float64."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from fit_material.renderer.camera_files.mitsuba_file import Node

Matrix = Float[np.ndarray, "4 4"]
_AXES = ("x", "y", "z")


def transform(node: Node) -> Matrix:
    """The matrix of a `transform`: its parts one after another, points being columns.

    Raises:
        InputError: a part is no transform of Mitsuba's, or has no finite numbers.
    """
    node.attributes(("name",))
    matrix = np.eye(4)
    for part in node.children():
        if part.element.tag not in _PARTS:
            raise node.refused(f"with <{part.element.tag}>", f"no elements but {', '.join(_PARTS)}")
        if len(part.element):
            raise part.refused("with elements inside", "numbers alone")
        with np.errstate(all="ignore"):  # not finite afterwards
            matrix = _PARTS[part.element.tag](part) @ matrix
        if not np.isfinite(matrix).all():
            raise part.refused("beyond all numbers", "a transform that moves points by a finite length")
    return matrix


def _translate(node: Node) -> Matrix:
    matrix = np.eye(4)
    matrix[:3, 3] = _vector(node, 0.0)
    return matrix


def _scale(node: Node) -> Matrix:
    return np.diag([*_vector(node, 1.0), 1.0])


def _rotate(node: Node) -> Matrix:
    """R = cos θ 1 + sin θ [a]ₓ + (1 - cos θ) a aᵀ, of an axis a that is a unit vector."""
    axis, angle = _vector(node, 0.0, "angle"), np.deg2rad(node.number_in(node.element.attrib["angle"]))
    if not abs(np.linalg.norm(axis) - 1) < 1e-3:  # Mitsuba takes it as it is
        raise node.refused(f"about {axis.tolist()}", "an axis of length 1")
    cross = np.cross(axis, np.eye(3)).T  # its columns are a × x, a × y, a × z
    matrix = np.eye(4)
    matrix[:3, :3] = np.cos(angle) * np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * np.outer(axis, axis)
    return matrix


def _lookat(node: Node) -> Matrix:
    """Columns left, up, along and origin; without an upward direction one of Mitsuba's."""
    values = node.attributes(("origin", "target"), ("up",))
    origin, target = (np.array(node.numbers_in(values[key], (3,))) for key in ("origin", "target"))
    up = np.array(node.numbers_in(values.get("up") or "0 0 0", (3,)))
    along = _unit(node, target - origin)
    left = _unit(node, np.cross(up if up.any() else _perpendicular(along), along))
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([left, np.cross(along, left), along, origin])
    return matrix


def _unit(node: Node, vector: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    length = np.linalg.norm(vector)
    if not 0 < length < np.inf:
        raise node.refused("without a direction", "an origin apart from its target, and up not along the line of sight")
    return vector / length


def _perpendicular(along: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """The first vector of the basis around a unit vector.  [Duff 2017, Building an Orthonormal Basis, Revisited]"""
    x, y, z = along
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    return np.array([1 + sign * x * x * a, sign * x * y * a, -sign * x])


def _matrix(node: Node) -> Matrix:
    numbers = np.array(node.numbers_in(node.attributes(("value",))["value"], (9, 16)))
    matrix = np.eye(4)
    size = 3 if len(numbers) == 9 else 4
    matrix[:size, :size] = numbers.reshape(size, size)
    if not np.array_equal(matrix[3], [0, 0, 0, 1]):  # Mitsuba takes no notice of that row
        raise node.refused(f"with {matrix[3].tolist()} as its last row", "0 0 0 1 there")
    return matrix


def _vector(node: Node, missing: float, *further: str) -> Float[np.ndarray, " 3"]:
    """The numbers of `value`, one for all or three, or of x, y and z."""
    if "value" in node.element.attrib:
        numbers = node.numbers_in(node.attributes(("value", *further))["value"], (1, 3))
        return np.array(numbers * 3 if len(numbers) == 1 else numbers)
    values = node.attributes(further, _AXES)
    return np.array([node.number_in(values[axis]) if axis in values else missing for axis in _AXES])


_PARTS: Mapping[str, Callable[[Node], Matrix]] = MappingProxyType(
    {"translate": _translate, "scale": _scale, "rotate": _rotate, "lookat": _lookat, "matrix": _matrix}
)
