"""Cameras from the sensors of a Mitsuba scene file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fit_material.renderer.camera_files.mitsuba_file import Node, sensors_of
from fit_material.renderer.camera_files.mitsuba_transforms import transform
from fit_material.renderer.errors.input_error import InputError

MITSUBA_AXES = np.diag([-1.0, 1.0, -1.0, 1.0])  # its cameras look along +Z with +X to the left
WIDTH, HEIGHT = 768, 576  # of Mitsuba's film, where its file is silent
FULL_FRAME = math.hypot(36, 24)  # mm, the diagonal that Mitsuba's focal lengths are for
SQUARE = 1e-4  # relative difference of width and height below which a pixel is one

_NUMBER, _COUNT, _TEXT, _FLAG = ("float", "integer"), ("integer",), ("string",), ("boolean",)
_SENSOR = {
    **dict.fromkeys(("near_clip", "far_clip", "focus_distance", "shutter_open", "shutter_close"), _NUMBER),
    "to_world": ("transform",),
}
_LENS = {"fov": _NUMBER, "fov_axis": _TEXT, "focal_length": _TEXT}
_OFFSETS = {"principal_point_offset_x": _NUMBER, "principal_point_offset_y": _NUMBER}
PROPERTIES: Mapping[str, Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "orthographic": _SENSOR,
        "perspective": {**_SENSOR, **_LENS, **_OFFSETS},
        "thinlens": {**_SENSOR, **_LENS, "aperture_radius": _NUMBER},
    }
)
"""Of each kind of sensor what Mitsuba knows of it, and as which types; what cameras do not need is not looked at."""

_CROP = ("crop_width", "crop_height", "crop_offset_x", "crop_offset_y")
_FILM = {
    **dict.fromkeys(("width", "height", *_CROP), _COUNT),
    **dict.fromkeys(("pixel_format", "component_format", "file_format"), _TEXT),
    **dict.fromkeys(("sample_border", "compensate", "banner"), _FLAG),
}
_SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
_SAMPLER = {"sample_count": _COUNT, "seed": _COUNT, "jitter": _FLAG, "strength": _COUNT}
_FILTERS = ("box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos")
_FILTER: dict[str, tuple[str, ...]] = dict.fromkeys(("radius", "stddev", "B", "C", "lobes"), _NUMBER)


def read_sensors(path: Path) -> list[dict[str, Any]]:
    """The cameras of a scene file, as the tables that `scene.toml` would hold for photographs without their images.

    They are Mitsuba's cameras to its float32, without anything of Mitsuba's, whose scene files name libraries to run.

    Raises:
        InputError: the file is no XML of Mitsuba's, has no sensor, or one that is neither perspective nor orthographic,
            that sees a part of its film only, or that has something inside that sensors do not have.
    """
    sensors = sensors_of(path)
    if not sensors:
        raise InputError(path, expected="at least one sensor, not in an include")
    return [{"camera": _camera(sensor)} for sensor in sensors]


def _camera(sensor: Node) -> dict[str, Any]:
    """The camera's table."""
    kind = sensor.kind(PROPERTIES)
    parts = sensor.parts(PROPERTIES[kind], ("film", "sampler"))
    if "sampler" in parts:
        parts["sampler"].kind(_SAMPLERS)
        parts["sampler"].parts(_SAMPLER)
    width, height = _film(parts["film"]) if "film" in parts else (WIDTH, HEIGHT)
    matrix = transform(parts["to_world"]) if "to_world" in parts else np.eye(4)
    if kind == "orthographic":  # its extent is the matrix's scaling
        half_width = _scales(sensor, matrix)
        return {"matrix": (matrix @ MITSUBA_AXES).tolist(), "projection": kind, "scale": half_width}
    focal = width / (2 * math.tan(math.radians(_x_fov(sensor, parts, width / height)) / 2))
    shifted = {  # Mitsuba adds its offset to the film position
        f"c{axis}": size * (0.5 - _number(parts, f"principal_point_offset_{axis}", 0.0))
        for axis, size in (("x", width), ("y", height))
    }
    lens = {"width": float(width), "height": float(height), "fx": focal, **shifted}
    return {"matrix": (matrix @ MITSUBA_AXES).tolist(), "lens": lens}


def _number(parts: Mapping[str, Node], name: str, missing: float) -> float:
    return parts[name].number() if name in parts else missing


def _film(film: Node) -> tuple[int, int]:
    """Its width and height in pixels, all of which are seen."""
    film.kind(("hdrfilm",))
    parts = film.parts(_FILM, ("rfilter",))
    if "rfilter" in parts:
        parts["rfilter"].kind(_FILTERS)
        parts["rfilter"].parts(_FILTER)
    size = {"width": WIDTH, "height": HEIGHT, "crop_offset_x": 0, "crop_offset_y": 0}
    size |= {name: part.whole_number() for name, part in parts.items() if name in (*size, *_CROP)}
    width, height, *offset = (size[name] for name in ("width", "height", "crop_offset_x", "crop_offset_y"))
    if not width or not height:
        raise film.refused("empty", "a film of one pixel at least")
    if any(offset) or (size.get("crop_width", width), size.get("crop_height", height)) != (width, height):
        raise film.refused("cropped", "a film that is seen as a whole")
    return width, height


def _scales(sensor: Node, matrix: np.ndarray) -> float:
    """Half the width that an orthographic sensor sees; takes the scaling out of its matrix."""
    half_width, half_height, depth = scales = np.linalg.norm(matrix[:3, :3], axis=0)
    if not scales.min() > 0 or abs(half_height / half_width - 1) > SQUARE:
        found = f"scaled by {half_width:g}, {half_height:g} and {depth:g}"
        raise InputError(sensor.file, f"{sensor.field}.to_world", found, "one scale of x and y, and none of 0")
    matrix[:3, :3] /= scales
    return float(half_width)


def _x_fov(sensor: Node, parts: Mapping[str, Node], aspect: float) -> float:
    """Horizontal field of view in degrees: by one along any side of the film, or by a focal length.

    Args:
        aspect: width over height.
    """
    if "fov" in parts and "focal_length" in parts:
        raise sensor.refused("with fov and focal_length", "one of the two")
    if "fov" in parts:
        half, axis = math.radians(parts["fov"].number()) / 2, _axis(parts, aspect)
    elif "fov_axis" in parts:
        raise sensor.refused("with fov_axis", "a fov beside it")
    else:
        half, axis = math.atan2(FULL_FRAME / 2, _focal_length(parts)), "diagonal"
    stretched = {"x": 1.0, "y": aspect, "diagonal": aspect / math.hypot(1.0, aspect)}[axis]
    x_fov = math.degrees(2 * math.atan(math.tan(half) * stretched))
    if not (0 < half < math.pi / 2 and 0 < x_fov < 180):
        field = "fov" if "fov" in parts else "focal_length"
        raise parts[field].refused(parts[field].text(), "a field of view above 0 and below 180 degrees")
    return x_fov


def _axis(parts: Mapping[str, Node], aspect: float) -> str:
    """The side of the film that the field of view is of: x, y or diagonal."""
    if "fov_axis" not in parts:
        return "x"
    axis = parts["fov_axis"].text().lower()
    sides = {"smaller": "y" if aspect > 1 else "x", "larger": "x" if aspect > 1 else "y"}
    if axis not in ("x", "y", "diagonal", *sides):
        raise parts["fov_axis"].refused(axis, "one of x, y, diagonal, smaller, larger")
    return sides.get(axis, axis)


def _focal_length(parts: Mapping[str, Node]) -> float:
    """In mm, for film of 36 mm × 24 mm; 50 where left out."""
    if "focal_length" not in parts:
        return 50.0
    return parts["focal_length"].number_in(parts["focal_length"].text().removesuffix("mm"))
