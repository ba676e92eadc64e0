"""Cameras kept under F1 to F4, in a file beside the model: ball.obj has ball.cameras.toml.

Beside the model, because that is what they belong to: whoever is given the folder sees what was meant to be seen. The
words are those of scene.toml's cameras, so that a camera can be copied from one file to the other.
"""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping
from pathlib import Path

import torch

from fit_material.renderer.files.atomic import write_text_atomically
from fit_material.renderer.files.toml import load_toml
from fit_material.renderer.files.validation import Checked, check
from fit_material.renderer.scene.scene_file import CameraSpec, camera_of
from fit_material.renderer.viewer.eye import Eye, Vector, eye_of

_HEAD = "# Cameras kept by fit-material view: F1 to F4 go to them, Shift+F1 to Shift+F4 replace them.\n"


class _Cameras(Checked):
    """The file: a camera for each key that has one."""

    F1: CameraSpec | None = None
    F2: CameraSpec | None = None
    F3: CameraSpec | None = None
    F4: CameraSpec | None = None


class Bookmarks(MutableMapping[str, Eye]):
    """The kept eyes by "f1" … "f4". Keeping one writes the file; a file that is broken is never touched.

    Args:
        path: the file; it need not be there.

    Raises:
        InputError: on keeping a camera, where the file there is broken or cannot be written. The camera is then kept
            until the viewer is closed, as the ones before it are.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._in_file: dict[str, Eye] = {}
        self._unsaved: dict[str, Eye] = {}

    def load(self) -> None:
        """Read the file, if there is one.

        Raises:
            InputError: it is broken.
        """
        self._in_file = read_bookmarks(self.path)

    def __setitem__(self, key: str, eye: Eye) -> None:
        self._unsaved[key] = eye
        kept = read_bookmarks(self.path) | self._unsaved  # another window may have kept a camera since
        write_text_atomically(self.path, _text(kept))
        self._in_file, self._unsaved = kept, {}

    def __getitem__(self, key: str) -> Eye:
        return self._all()[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def _all(self) -> dict[str, Eye]:
        return self._in_file | self._unsaved

    def __delitem__(self, key: str) -> None:
        raise TypeError("a kept camera is replaced, never removed")


def bookmarks_file(model: Path) -> Path:
    """Where the cameras of a model are kept."""
    return model.with_name(f"{model.stem}.cameras.toml")


def read_bookmarks(path: Path) -> dict[str, Eye]:
    """The eyes in a file by "f1" … "f4"; none where there is no file.

    Raises:
        InputError: the file is no TOML, or a camera in it is none that scene.toml could have.
    """
    if not path.exists():
        return {}
    cameras = check(_Cameras, load_toml(path, "file of cameras"), path)
    return {key.lower(): _eye(spec) for key, spec in cameras if spec is not None}


def _eye(spec: CameraSpec) -> Eye:
    camera = camera_of(spec, 1, 1)
    return eye_of(camera, spec.target or _one_ahead(camera.camera_to_world))


def _one_ahead(pose: torch.Tensor) -> Vector:
    """A centre of rotation, for a pose that was given as a matrix."""
    x, y, z = (pose[:3, 3] - pose[:3, 2]).tolist()
    return x, y, z


def _text(eyes: dict[str, Eye]) -> str:
    return _HEAD + "".join(_table(key, eyes[key]) for key in sorted(eyes))


def _table(key: str, eye: Eye) -> str:
    """One camera; `up` is the picture's own, which is never parallel to the view. A float's repr is exact."""
    orthographic = eye.projection == "orthographic"
    lens = f'projection = "orthographic"\nscale = {eye.scale}' if orthographic else f"fov = {eye.fov}"
    return f"""
[{key.upper()}]
origin = {eye.origin.tolist()}
target = {list(eye.target)}
up = {eye.rotation[:, 1].tolist()}
{lens}
"""
