"""Environment maps from files: a latitude–longitude picture, or the six faces of a cube."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.images.image_header import RADIANCE, Size, require_size
from fit_material.renderer.images.samples import FORMATS, image_size


def read_environment(path: str | Path, rotation: float = 0.0, scale: float = 1.0) -> Environment:
    """Read the surroundings from a latitude-longitude image or from six faces of a cube.

    Args:
        path: an image twice as wide as high; or a folder with images named px nx py ny pz nz (OpenGL's
            orientation, square, of equal size), which become a map of four times their width.
        rotation: degrees about +Y, counter-clockwise seen from above.
        scale: factor on the radiance, > 0.

    Returns:
        The map, its negative texels set to 0 and its non-finite ones to the mean of their finite neighbours.

    Raises:
        InputError: a file is missing or unreadable, its shape is wrong, everything is black, or a number is
            out of range.
    """
    path = Path(path)
    if not math.isfinite(rotation):
        raise InputError(path, "rotation", rotation, "a finite angle in degrees")
    if not (math.isfinite(scale) and scale > 0):
        raise InputError(path, "scale", scale, "a finite number > 0")
    texels, repaired = _from_faces(path) if path.is_dir() else _from_latlong(path)
    if not texels.any():
        raise InputError(path, expected="light from somewhere, but no texel is a finite number above 0")
    radiance = scale * torch.from_numpy(texels).double()
    if radiance.max() > torch.finfo(torch.float32).max:
        raise InputError(path, "scale", scale, "a factor that keeps the radiance below 3e38")
    return Environment(radiance.float(), rotation, repaired)


def _from_latlong(path: Path) -> tuple[Float[np.ndarray, "h w 3"], int]:
    radiance = read_image(path).radiance
    height, width = radiance.shape[:2]
    if width != 2 * height:
        raise InputError(path, "size", f"{width} × {height}", "a map twice as wide as high")
    return _repair(radiance)


def _from_faces(folder: Path) -> tuple[Float[np.ndarray, "h w 3"], int]:
    """Six faces, resampled: two map rows per face row keep every texel that the faces have."""
    from fit_material.renderer.environment.cubemap import FACES, Cubemap, lookup

    files = [_face_file(folder, name) for name in FACES]
    _require_small(folder, files)
    faces, repaired = zip(*map(_read_face, files), strict=True)
    size = len(faces[0])
    for name, face in zip(FACES, faces, strict=True):
        if len(face) != size:
            side = f"{len(face)} × {len(face)}"
            raise InputError(folder, name, side, f"the size of {FACES[0]}, {size} × {size}")
    cubemap = Cubemap(torch.from_numpy(np.stack(faces)))
    return lookup(cubemap, directions(2 * size, 4 * size)).numpy(), sum(repaired)


def _face_file(folder: Path, name: str) -> Path:
    found = [path for path in sorted(folder.iterdir()) if path.stem == name and path.suffix.lower() in FORMATS]
    if len(found) != 1:
        raise InputError(folder, name, f"{len(found)} files", "one image per face: px nx py ny pz nz")
    return found[0]


def _read_face(path: Path) -> tuple[Float[np.ndarray, "n n 3"], int]:
    radiance = read_image(path).radiance
    height, width = radiance.shape[:2]
    if width != height:
        raise InputError(path, "size", f"{width} × {height}", "a square face")
    return _repair(radiance)


def _repair(radiance: Float[np.ndarray, "h w 3"]) -> tuple[Float[np.ndarray, "h w 3"], int]:
    """Set negative values to 0 and non-finite ones to the mean of their finite neighbours; count texels."""
    broken = ~np.isfinite(radiance)
    negative = ~broken & (radiance < 0)
    clean = np.where(broken | negative, np.float32(0), radiance)
    if broken.any():
        total, finite = _sum_of_neighbours(clean), _sum_of_neighbours((~broken).astype(np.float32))
        clean = np.where(broken, total / np.maximum(finite, 1), clean).astype(np.float32)
    return clean, int((broken | negative).any(-1).sum())


def _sum_of_neighbours(values: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
    """Sum over the 3 × 3 texels around each one, which are fewer at the borders; float64, for nine may be too much."""
    height, width = values.shape[:2]
    padded = np.pad(values.astype(np.float64), ((1, 1), (1, 1), (0, 0)))
    shifted = (padded[j : j + height, i : i + width] for j in range(3) for i in range(3))
    return np.sum(list(shifted), axis=0)


def _require_small(folder: Path, files: Sequence[Path]) -> None:
    """Refuse faces of which each fits into memory, but not the map that they become."""
    sizes = [image_size(file) for file in files]
    width = max(size.width for size in sizes)
    require_size(folder, Size(4 * width, 2 * width, sum(RADIANCE * size.width * size.height for size in sizes)))
