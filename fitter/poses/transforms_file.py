"""Cameras as `transforms.json` has them, for `cameras` of a scene file and for other programs."""

from __future__ import annotations

import json
import math
from typing import Any

from fit_material.fitter.observations.scene_data import Loaded
from fit_material.renderer.cameras.camera import Camera


def transforms_json(loaded: Loaded) -> str | None:
    """The cameras of a scene's photographs, in their order; None where one is orthographic, which the format lacks."""
    cameras = [thumbnail.camera for thumbnail in loaded.photographs.thumbnails]
    if any(camera.projection == "orthographic" for camera in cameras):
        return None
    pairs = zip(cameras, loaded.scene.photographs, strict=True)
    frames = [{"file_path": str(spec.image.absolute()), **_frame(camera)} for camera, spec in pairs]
    return json.dumps({"frames": frames}, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _frame(camera: Camera) -> dict[str, Any]:
    pose = {"transform_matrix": camera.camera_to_world.tolist()}
    if camera.lens is None:
        return {"camera_angle_x": math.radians(camera.fov), **pose}
    lens = camera.lens
    size = {"w": camera.width, "h": camera.height, "fl_x": lens.fx, "fl_y": lens.fy, "cx": lens.cx, "cy": lens.cy}
    return {**size, **{key: getattr(lens, key) for key in ("k1", "k2", "k3", "p1", "p2")}, **pose}
