"""Cameras from other programs' files, whichever of them it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fit_material.renderer.camera_files.colmap import read_colmap
from fit_material.renderer.camera_files.mitsuba_sensors import read_sensors
from fit_material.renderer.camera_files.nerf_transforms import read_transforms
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import require_regular


def read_cameras(path: Path, images: Sequence[str] | None) -> list[dict[str, Any]]:
    """Photographs with their cameras, as the tables that `scene.toml` would hold.

    Args:
        path: a folder with a COLMAP model, a Mitsuba scene (.xml), or a transforms.json.
        images: the files of photographs that are listed, which COLMAP's cameras are looked up by; None where the
            file itself has to name them.

    Raises:
        InputError: as the readers; or a file that names no images has to.
    """
    require_regular(path)
    if path.is_dir():
        return read_colmap(path, images)
    if path.suffix.lower() == ".xml":
        if images is None:
            raise InputError(path, expected="[[photographs]] in the scene, one for each sensor: it names no images")
        return read_sensors(path)
    return read_transforms(path, images=images is None)


def with_cameras(scene_file: Path, listed: Any, cameras: Path) -> Any:
    """The photographs' tables: those that a scene lists, or those of the file's own images, each with its camera.

    Raises:
        InputError: as `read_cameras`; there are more or fewer photographs than cameras, or one has a camera already.
    """
    if listed is None:
        return read_cameras(cameras, None)
    if not (isinstance(listed, list) and all(isinstance(table, dict) for table in listed)):
        return listed  # of the wrong type, which the check of the whole scene reports best
    frames = read_cameras(cameras, [_first_image(table) for table in listed])
    if len(listed) != len(frames):
        remedy = f"as many as {cameras.name} has cameras, {len(frames)}"
        raise InputError(scene_file, "photographs", f"a list of {len(listed)}", remedy)
    for index, table in enumerate(listed):
        if "camera" in table:
            raise InputError(scene_file, f"photographs[{index}].camera", expected=f"no camera beside {cameras.name}")
    return [{**table, **frame} for table, frame in zip(listed, frames, strict=True)]


def _first_image(table: dict[str, Any]) -> str:
    """What a photograph's table calls its image, or the first of several; its own check tests whether it is one."""
    images = table.get("images") or [table.get("image")]
    return str(images[0] if isinstance(images, list) else images)
