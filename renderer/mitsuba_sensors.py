"""Cameras from the sensors of a Mitsuba scene file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from renderer.errors import InputError
from renderer.to_mitsuba import mitsuba

MITSUBA_AXES = np.diag([-1.0, 1.0, -1.0, 1.0])  # its cameras look along +Z with +X to the left
FEATURES = {"perspective", "orthographic", "thinlens"}


def read_sensors(path: Path) -> list[dict[str, Any]]:
    """The cameras of a scene file, as the tables that `scene.toml` would hold for photographs without their images.

    Mitsuba itself reads them, with the file's `default`s, and nothing else of the scene.

    Raises:
        InputError: the file is no XML of Mitsuba's, has no sensor, or one that is neither perspective nor orthographic
            or that sees a part of its film only.
    """
    root = _root(path)
    sensors = [element for element in root if element.tag == "sensor"]
    if not sensors:
        raise InputError(path, expected="at least one sensor, not in an include")
    return [{"camera": _camera(path, f"sensor[{i}]", root, sensor)} for i, sensor in enumerate(sensors)]


def _root(path: Path) -> Element:
    try:
        return ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError, ValueError) as error:
        raise InputError(path, expected=f"a readable XML file ({error})") from None


def _camera(path: Path, field: str, root: Element, element: Element) -> dict[str, Any]:
    """The camera's table."""
    kind = element.get("type", "")
    if kind not in FEATURES:
        raise InputError(path, field, kind or "without a type", f"one of {', '.join(sorted(FEATURES))}")
    sensor = _loaded(path, field, root, element)
    film = sensor.film()
    if list(film.crop_size()) != list(film.size()):
        raise InputError(path, f"{field}.film", "cropped", "a film that is seen as a whole")
    width, height = map(float, film.size())
    matrix = np.array(sensor.world_transform().matrix, float)
    if kind == "orthographic":  # its extent is the matrix's scaling
        half_width, *others = np.linalg.norm(matrix[:3, :3], axis=0)
        matrix[:3, :3] /= [half_width, *others]
        return {"matrix": (matrix @ MITSUBA_AXES).tolist(), "projection": kind, "scale": half_width}
    said = _numbers(sensor)
    focal = width / (2 * math.tan(math.radians(said["x_fov"]) / 2))
    shifted = {  # Mitsuba adds its offset to the film position
        f"c{axis}": size * (0.5 - said.get(f"principal_point_offset_{axis}", 0.0))
        for axis, size in (("x", width), ("y", height))
    }
    lens = {"width": width, "height": height, "fx": focal, **shifted}
    return {"matrix": (matrix @ MITSUBA_AXES).tolist(), "lens": lens}


def _loaded(path: Path, field: str, root: Element, element: Element) -> Any:
    """The sensor as Mitsuba makes it, of a scene with nothing else in it."""
    mi = mitsuba("scalar_rgb")
    alone = Element("scene", version=root.get("version", "3.0.0"))
    alone.extend([default for default in root if default.tag == "default"])
    alone.append(element)
    try:
        return mi.load_string(ElementTree.tostring(alone, "unicode")).sensors()[0]
    except Exception as error:  # of whatever type its parser chooses
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        reason = lines[-1].rstrip(".") if lines else type(error).__name__
        raise InputError(path, field, expected=f"a sensor that Mitsuba reads ({reason})") from error


def _numbers(sensor: Any) -> dict[str, float]:
    import mitsuba as mi

    found = mi.traverse(sensor)
    names = ("x_fov", "principal_point_offset_x", "principal_point_offset_y")
    return {name: float(np.array(found[name]).ravel()[0]) for name in names if name in found}
