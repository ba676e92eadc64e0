"""Cameras from COLMAP's sparse models, text or binary."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_text, require_regular
from fit_material.renderer.files.validation import existing_file, shortened

T = TypeVar("T")

MODELS: dict[str, tuple[int, tuple[str, ...]]] = {
    "SIMPLE_PINHOLE": (0, ("f", "cx", "cy")),
    "PINHOLE": (1, ("fx", "fy", "cx", "cy")),
    "SIMPLE_RADIAL": (2, ("f", "cx", "cy", "k1")),
    "RADIAL": (3, ("f", "cx", "cy", "k1", "k2")),
    "OPENCV": (4, ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
    "FULL_OPENCV": (6, ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
}
"""COLMAP's numbers for those of its camera models that OpenCV's five distortions hold, and their parameters."""

OPENCV_AXES = np.diag([1.0, -1.0, -1.0])  # its cameras look along +Z with +Y down, ours along -Z with +Y up


class _View(NamedTuple):
    """An image of the model: its name, rotation (w, x, y, z) and translation from world to camera, camera's id."""

    name: str
    rotation: tuple[float, ...]
    translation: tuple[float, ...]
    camera: int


def read_colmap(folder: Path, images: Sequence[str] | None) -> list[dict[str, Any]]:
    """Photographs of a sparse model, as the tables that `scene.toml` would hold.

    Args:
        folder: with cameras and images as .bin or .txt.
        images: of which files cameras are wanted; None for all, with the image files, by name. Names are relative to
            the model's pictures, or are unique ends of such names.

    Raises:
        InputError: a file is missing or no COLMAP's, a camera has other than OpenCV's five distortions, or an image
            is not in the model or, where they are sought, not in a folder `images` beside it.
    """
    source, pictures = model_files(folder)
    binary = source.suffix == ".bin"
    lenses = dict(_whole(source, _binary_cameras if binary else _text_cameras))
    views = sorted(_whole(pictures, _binary_views if binary else _text_views))
    if images is not None:
        return [{"camera": _camera(_named(views, name, pictures), lenses, source, pictures)} for name in images]
    if not views:
        raise InputError(pictures, expected="at least one image")
    return [
        {"camera": _camera(view, lenses, source, pictures), "image": _image(folder, view.name, pictures)}
        for view in views
    ]


def model_files(folder: Path) -> tuple[Path, Path]:
    """The files of a model that hold its cameras and its images, binary ones first, as COLMAP itself looks for them.

    Raises:
        InputError: there are none.
    """
    for ending in (".bin", ".txt"):
        if (folder / f"cameras{ending}").is_file():
            return folder / f"cameras{ending}", folder / f"images{ending}"
    raise InputError(folder, expected="a COLMAP model in this folder, with cameras.bin or cameras.txt")


def _whole(path: Path, parts: Callable[[Path], Iterator[T]]) -> list[T]:
    """All parts of a file, none of which may be cut off or unreadable."""
    require_regular(path)
    try:
        return list(parts(path))
    except InputError:
        raise
    except (OSError, ValueError, IndexError, struct.error, MemoryError, OverflowError) as error:
        reason = "there is none" if isinstance(error, FileNotFoundError) else "it is cut off, or no COLMAP's"
        raise InputError(path, expected=f"a readable file of a COLMAP model ({reason})") from None


def _text_cameras(path: Path) -> Iterator[tuple[int, dict[str, float]]]:
    for line in read_text(path, "utf-8").splitlines():
        if line.strip() and not line.startswith("#"):
            number, model, width, height, *parameters = line.split()
            if model not in MODELS:
                raise _other_model(path, model)
            yield int(number), _lens(path, model, (width, height), parameters)


def _text_views(path: Path) -> Iterator[_View]:
    """Two lines each, of which the second, of points, may be empty."""
    lines = [line for line in read_text(path, "utf-8").splitlines() if not line.startswith("#")]
    for line in lines[::2]:
        if line.strip():
            _, *pose, camera, name = line.split(maxsplit=9)
            numbers = tuple(map(float, pose))
            yield _View(name.strip(), numbers[:4], numbers[4:], int(camera))


def _binary_cameras(path: Path) -> Iterator[tuple[int, dict[str, float]]]:
    names = {number: name for name, (number, _) in MODELS.items()}
    with path.open("rb") as file:
        for _ in range(*_unpacked(file, "Q")):
            number, model, width, height = _unpacked(file, "iiQQ")
            if model not in names:
                raise _other_model(path, f"number {model}")
            parameters = _unpacked(file, f"{len(MODELS[names[model]][1])}d")
            yield number, _lens(path, names[model], (width, height), parameters)


def _binary_views(path: Path) -> Iterator[_View]:
    with path.open("rb") as file:
        for _ in range(*_unpacked(file, "Q")):
            _, *pose, camera = _unpacked(file, "i7di")
            name = b"".join(iter(lambda: file.read(1).strip(b"\0"), b"")).decode("utf-8")
            points = _unpacked(file, "Q")[0]
            file.seek(points * struct.calcsize("<ddq"), 1)
            yield _View(name, tuple(pose[:4]), tuple(pose[4:]), camera)


def _unpacked(file: BinaryIO, layout: str) -> tuple[Any, ...]:
    return struct.unpack(f"<{layout}", file.read(struct.calcsize(f"<{layout}")))


def _other_model(path: Path, model: str) -> InputError:
    expected = f"one of {', '.join(MODELS)}; or let COLMAP's image_undistorter make pinholes of them"
    return InputError(path, "camera model", shortened(model), expected)


def _lens(path: Path, model: str, size: Sequence[Any], parameters: Sequence[Any]) -> dict[str, float]:
    """The lens's table; COLMAP's lengths are ours: in pixels, from the picture's corner."""
    said = dict(zip(MODELS[model][1], map(float, parameters), strict=True))
    for key in ("k4", "k5", "k6"):
        if said.pop(key, 0.0) != 0:
            raise InputError(path, key, expected="0: OpenCV's rational distortion is not among what is read")
    width, height = map(float, size)
    focal = said.pop("f", None)
    return {"width": width, "height": height, **({"fx": focal} if focal is not None else {}), **said}


def _camera(view: _View, lenses: dict[int, dict[str, float]], source: Path, pictures: Path) -> dict[str, Any]:
    """The camera's table."""
    if view.camera not in lenses:
        raise InputError(source, expected=f"camera {view.camera}, which took {shortened(view.name)}")
    return {"matrix": _camera_to_world(view, pictures).tolist(), "lens": lenses[view.camera]}


def _camera_to_world(view: _View, pictures: Path) -> Float[np.ndarray, "4 4"]:
    """The pose in our axes; the file's is x_camera = R x_world + t in OpenCV's."""
    from scipy.spatial.transform import Rotation

    if not (np.isfinite(view.rotation).all() and np.any(view.rotation)):
        told = " ".join(f"{each:g}" for each in view.rotation)
        raise InputError(
            pictures, f"rotation of {shortened(view.name)}", told, "a quaternion of finite numbers, not all 0"
        )
    world_to_camera = Rotation.from_quat(view.rotation, scalar_first=True).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = world_to_camera.T @ OPENCV_AXES
    matrix[:3, 3] = -world_to_camera.T @ view.translation
    return matrix


def _named(views: Sequence[_View], name: str, pictures: Path) -> _View:
    """The image of that name, or the only one whose name ends so or that ends a path so."""
    wanted = PurePosixPath(Path(name).as_posix()).parts
    for least in (len(wanted), 1):
        found = [view for view in views if _in_common(PurePosixPath(view.name).parts, wanted) >= least]
        if len(found) == 1:
            return found[0]
    which = "none is called so" if not found else f"{len(found)} are called so"
    raise InputError(pictures, expected=f"one image {shortened(name)}, but {which}")


def _in_common(a: Sequence[str], b: Sequence[str]) -> int:
    """How many of the last parts of two paths are the same."""
    same = [x == y for x, y in zip(reversed(a), reversed(b), strict=False)]
    return same.index(False) if False in same else len(same)


def _image(folder: Path, name: str, pictures: Path) -> str:
    """The image's file, in `images` beside the model, as in COLMAP's own projects, or beside or above it."""
    for base in (folder, *folder.absolute().parents[:2]):
        for found in (existing_file(base / "images" / name, folder), existing_file(base / name, folder)):
            if found is not None:
                return str(found)
    expected = f"an image {shortened(name)} in a folder images beside the model"
    raise InputError(pictures, expected=expected)
