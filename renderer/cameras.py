"""Cameras from other programs' files, whichever of them it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from renderer.colmap import read_colmap
from renderer.errors import InputError
from renderer.mitsuba_sensors import read_sensors
from renderer.transforms import read_transforms


def read_cameras(path: Path, images: Sequence[str] | None) -> list[dict[str, Any]]:
    """Photographs with their cameras, as the tables that `scene.toml` would hold.

    Args:
        path: a folder with a COLMAP model, a Mitsuba scene (.xml), or a transforms.json.
        images: the files of photographs that are listed, which COLMAP's cameras are looked up by; None where the
            file itself has to name them.

    Raises:
        InputError: as the readers; or a file that names no images has to.
    """
    if path.is_dir():
        return read_colmap(path, images)
    if path.suffix.lower() == ".xml":
        if images is None:
            raise InputError(path, expected="[[photographs]] in the scene, one for each sensor: it names no images")
        return read_sensors(path)
    return read_transforms(path, images=images is None)
