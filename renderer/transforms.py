"""Cameras from `transforms.json`, the format of NeRF's Blender scenes and of nerfstudio."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, PositiveFloat, Strict

from renderer.checked import Checked, RigidMotion, check, existing_file, shortened
from renderer.errors import InputError
from renderer.images import FORMATS


class _Lens(Checked):
    """What both the file and each of its frames may say about the lens; lengths in pixels."""

    model_config = ConfigDict(extra="ignore")

    camera_angle_x: Annotated[float, Field(gt=0, lt=math.pi)] | None = None
    fl_x: PositiveFloat | None = None
    fl_y: PositiveFloat | None = None
    cx: float | None = None
    cy: float | None = None
    w: PositiveFloat | None = None
    h: PositiveFloat | None = None
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    p1: float = 0.0
    p2: float = 0.0


class _Frame(_Lens):
    file_path: str
    transform_matrix: RigidMotion


class _Transforms(_Lens):
    frames: Annotated[tuple[_Frame, ...], Strict(False), Field(min_length=1)]


def read_transforms(path: Path, images: bool) -> list[dict[str, Any]]:
    """The photographs of a `transforms.json`, as the tables that `scene.toml` would hold.

    Args:
        path: the file; its `file_path`s are relative to it and may lack their ending.
        images: look for the image files, too; otherwise only the cameras are given.

    Raises:
        InputError: the file is not such JSON, a matrix is no rigid motion, an image is missing, or the lens
            is not a centred pinhole with square pixels.
    """
    transforms = check(_Transforms, _load_json(path), path)
    photographs = []
    for index, frame in enumerate(transforms.frames):
        said = {**transforms.model_dump(exclude_unset=True), **frame.model_dump(exclude_unset=True)}
        lens = _Lens.model_construct(**said)
        photograph: dict[str, Any] = {"camera": {"matrix": frame.transform_matrix, "fov": _fov(path, index, lens)}}
        if images:
            photograph["image"] = _image(path, index, frame.file_path)
        photographs.append(photograph)
    return photographs


def _load_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text("utf-8-sig"))
    except json.JSONDecodeError as error:
        raise InputError(path, f"line {error.lineno}, column {error.colno}", expected=f"JSON ({error.msg})") from None
    except RecursionError:
        raise InputError(path, expected="JSON without hundreds of lists inside each other") from None
    except (OSError, ValueError) as error:
        raise InputError(path, expected=f"a readable JSON file ({error})") from None


def _fov(path: Path, index: int, lens: _Lens) -> float:
    """Full horizontal angle in degrees; anything but a centred pinhole is refused, for we would ignore it."""
    _check_pinhole(path, index, lens)
    if lens.camera_angle_x is not None:
        return math.degrees(lens.camera_angle_x)
    if lens.fl_x is None or lens.w is None:
        raise InputError(path, f"frames[{index}]", expected="camera_angle_x, or fl_x and w, here or in the file")
    return math.degrees(2 * math.atan(lens.w / (2 * lens.fl_x)))


def _check_pinhole(path: Path, index: int, lens: _Lens) -> None:
    for name in ("k1", "k2", "k3", "k4", "p1", "p2"):
        if getattr(lens, name) != 0:
            raise InputError(path, f"frames[{index}].{name}", getattr(lens, name), "0: undistort the images first")
    for name, centre, size in (("cx", lens.cx, lens.w), ("cy", lens.cy, lens.h)):
        if centre is not None and size is not None and abs(centre - size / 2) > 0.5:
            raise InputError(path, f"frames[{index}].{name}", centre, f"the image's centre {size / 2}: crop it so")
    if lens.fl_x is not None and lens.fl_y is not None and abs(lens.fl_y / lens.fl_x - 1) > 1e-3:
        raise InputError(path, f"frames[{index}].fl_y", lens.fl_y, f"square pixels, fl_x = {lens.fl_x}")


def _image(path: Path, index: int, file_path: str) -> str:
    image = path.parent.absolute() / file_path
    for candidate in (image, *(image.parent / f"{image.name}{ending}" for ending in FORMATS)):
        if existing_file(candidate, path.parent) is not None:
            return str(candidate)
    expected = f"an image {shortened(str(image))}, with or without its ending"
    raise InputError(path, f"frames[{index}].file_path", shortened(file_path), expected)
