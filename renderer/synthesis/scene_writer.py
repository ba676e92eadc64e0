"""What is written beside synthetic photographs: the scene file for a fit, the truth to compare it with."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import require_names
from fit_material.renderer.files.replaceable import Replaceable, contents, json_with, unchanged
from fit_material.renderer.files.unfinished import sweep
from fit_material.renderer.materials.ground_truth import TrueMaterial
from fit_material.renderer.scene.lights import LightSpec
from fit_material.renderer.synthesis.camera_placement import View
from fit_material.renderer.synthesis.viewer_photographer import thesis_material
from fit_material.shaders.materials.quantities import F0, QUANTITIES

TRUTH, SCENE, MAP = "truth.json", "scene.toml", "environment.exr"
KNOWN = f"one that the {TRUTH} there lists and nobody has changed"


def view_name(index: int) -> str:
    """The file of a photograph."""
    return f"view_{index}.exr"


def copied_mesh(mesh: Path | None, folder: Path) -> Path | None:
    """The mesh file, if the folder does not hold it already."""
    there = mesh is not None and (folder / mesh.name).exists() and os.path.samefile(mesh, folder / mesh.name)
    return None if there else mesh


def require_room_for_photographs(folder: Path, views: int, mesh: Path | None, inputs: Iterable[Path]) -> Replaceable:
    """What may be replaced in a folder of synthetic photographs, of which it is known by now that this is enough.

    Raises:
        InputError: a file that is to be written would be an input, or of somebody else, or its name is too long; or
            scene.toml cannot hold the mesh's.
    """
    if mesh is not None:
        _require_writable(mesh)
    copied = copied_mesh(mesh, folder)
    names = [SCENE, TRUTH, MAP, *map(view_name, range(views)), *([] if copied is None else [copied.name])]
    require_names(folder, names, "--mesh")
    sweep(folder)
    allowed = Replaceable(tuple(inputs), _written_here(folder, names), KNOWN)
    allowed.require(folder, names)
    return allowed


def _require_writable(mesh: Path) -> None:
    try:
        mesh.name.encode("utf-8")
    except UnicodeEncodeError:
        raise InputError("--mesh", value=mesh, expected="a file whose name is UTF-8, as scene.toml is") from None


def _written_here(folder: Path, names: Iterable[str]) -> dict[str, str | None]:
    """What a truth.json lists; of one of an older version, which listed nothing, all names that are usual."""
    truth = json_with(folder / TRUTH, "format", "materials", "model", "environment")
    if truth is None:
        return {}
    if "outputs" not in truth:
        return dict.fromkeys(names)
    try:
        listed = [*truth["outputs"], *truth.get("earlier_outputs", [])]
        return {TRUTH: None, **{str(file["path"]): str(file["sha256"]) for file in listed}}
    except (TypeError, KeyError):  # somebody else's
        return {}


def outputs_of(folder: Path, target: Path) -> dict[str, list[dict[str, str]]]:
    """The files of truth.json: `outputs`, and `earlier_outputs` where earlier calls left some.

    Args:
        folder: what has just been filled, but for truth.json, which cannot list itself.
        target: where its files go, with those of earlier calls.
    """
    new = contents(folder)
    earlier = {name: digest for name, digest in _written_here(target, ()).items() if name not in {TRUTH, *new}}
    left = unchanged(target, earlier)
    return {"outputs": _files(new), **({"earlier_outputs": _files(left)} if left else {})}


def _files(digests: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"path": name, "sha256": digest} for name, digest in digests.items()]


def scene_toml(mesh: Path | None, lights: Sequence[LightSpec], poses: Sequence[View]) -> str:
    """The scene as DESIGN.md's contract has it; a float's repr is exact, and valid TOML."""
    geometry = 'shape = "sphere"' if mesh is None else f"mesh = {_quoted(mesh.name)}\nsmooth = true"
    head = f'[geometry]\n{geometry}\n\n[environment]\nmap = "{MAP}"\nrotation = 0.0\nscale = 1.0\n'
    head += "".join(_light_toml(light) for light in lights)
    return head + "".join(_photograph_toml(index, pose) for index, pose in enumerate(poses))


def _light_toml(light: LightSpec) -> str:
    given = {key: value for key, value in light if value is not None}
    return "\n[[lights]]\n" + "".join(f"{key} = {_toml(value)}\n" for key, value in given.items())


def _toml(value: object) -> str:
    """A text, a number or a list of numbers."""
    if isinstance(value, str):
        return _quoted(value)
    return str(list(value) if isinstance(value, tuple) else value)


def _photograph_toml(index: int, pose: View) -> str:
    return f"""
[[photographs]]
image = "{view_name(index)}"
exposure = 1.0
[photographs.camera]
origin = {list(pose.origin)}
target = {list(pose.target)}
up = {list(pose.up)}
fov = {float(pose.fov)}
"""


def _quoted(text: str) -> str:
    """A TOML basic string, which JSON's strings are, but for DEL, which TOML wants escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def material_entry(name: str, material: TrueMaterial) -> dict[str, Any]:
    """A material by the names of result.json, None where it has none."""
    f0 = thesis_material(material).f0
    return {
        "name": name,
        "type": material.type,
        **{key: getattr(material, key, None) for key in QUANTITIES if key != F0.name},
        "f0": None if f0 is None else f0.tolist(),
        "distribution": material.distribution if material.alpha else None,
        "metal": getattr(material, "metal", None) or None,
        "source": getattr(material, "source", None) or None,
    }
