"""Cameras from `transforms.json`, the format of NeRF's Blender scenes and of nerfstudio."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, PositiveFloat, Strict

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_text
from fit_material.renderer.files.validation import Checked, RigidMotion, check, existing_file, shortened
from fit_material.renderer.images.samples import FORMATS

OPENCV_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
DISTORTION = ("k1", "k2", "p1", "p2", "k3")


class _Lens(Checked):
    """Lens parameters of the file or of a frame; lengths in pixels."""

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
    camera_model: str | None = None


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
        InputError: the file is not such JSON, a matrix is no rigid motion, an image is missing, or the lens has
            other than OpenCV's five distortions.
    """
    transforms = check(_Transforms, _load_json(path), path)
    photographs = []
    for index, frame in enumerate(transforms.frames):
        said = {**transforms.model_dump(exclude_unset=True), **frame.model_dump(exclude_unset=True)}
        lens = _Lens.model_construct(**said)
        camera = {"matrix": frame.transform_matrix, **_camera(path, index, lens)}
        photograph: dict[str, Any] = {"camera": camera}
        if images:
            photograph["image"] = _image(path, index, frame.file_path)
        photographs.append(photograph)
    return photographs


def _load_json(path: Path) -> Any:
    try:
        return json.loads(read_text(path, "utf-8-sig"))
    except json.JSONDecodeError as error:
        raise InputError(path, f"line {error.lineno}, column {error.colno}", expected=f"JSON ({error.msg})") from None
    except RecursionError:
        raise InputError(path, expected="JSON without hundreds of lists inside each other") from None
    except (OSError, ValueError) as error:
        raise InputError(path, expected=f"a readable JSON file ({error})") from None


def _camera(path: Path, index: int, lens: _Lens) -> dict[str, Any]:
    """The frame's lens: an angle of view, or intrinsics."""
    field = f"frames[{index}]"
    if lens.camera_model is not None and lens.camera_model not in OPENCV_MODELS:
        expected = f"one of {', '.join(OPENCV_MODELS)}: undistort the images first"
        raise InputError(path, f"{field}.camera_model", shortened(lens.camera_model), expected)
    if lens.k4 != 0:
        raise InputError(path, f"{field}.k4", lens.k4, "0: undistort the images first")
    if lens.camera_angle_x is None and (lens.fl_x is None or lens.w is None):
        raise InputError(path, field, expected="camera_angle_x, or fl_x and w, here or in the file")
    if (
        any(getattr(lens, key) for key in DISTORTION)
        or lens.fl_y not in (None, lens.fl_x)
        or (lens.cx, lens.cy) != (None, None)
    ):
        return {"lens": _intrinsics(path, field, lens)}
    if lens.camera_angle_x is not None:
        return {"fov": math.degrees(lens.camera_angle_x)}
    assert lens.fl_x is not None
    assert lens.w is not None
    return {"fov": math.degrees(2 * math.atan(lens.w / (2 * lens.fl_x)))}


def _intrinsics(path: Path, field: str, lens: _Lens) -> dict[str, float]:
    """The frame's lens as `scene.toml` would have it."""
    if lens.w is None or lens.h is None:
        raise InputError(path, field, expected="w and h beside fl_y, cx, cy and distortion, here or in the file")
    focal = lens.fl_x
    if focal is None:
        assert lens.camera_angle_x is not None
        focal = lens.w / (2 * math.tan(lens.camera_angle_x / 2))
    given = {"fy": lens.fl_y, "cx": lens.cx, "cy": lens.cy, **{key: getattr(lens, key) for key in DISTORTION}}
    size = {"width": lens.w, "height": lens.h, "fx": focal}
    return size | {key: value for key, value in given.items() if value is not None}


def _image(path: Path, index: int, file_path: str) -> str:
    image = path.parent.absolute() / file_path
    for candidate in (image, *(image.parent / f"{image.name}{ending}" for ending in FORMATS)):
        if existing_file(candidate, path.parent) is not None:
            return str(candidate)
    expected = f"an image {shortened(str(image))}, with or without its ending"
    raise InputError(path, f"frames[{index}].file_path", shortened(file_path), expected)
