"""One input after another into a reader: what it may do is read it or refuse it in a sentence."""

from __future__ import annotations

import ast
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from fit_material.fitter.batch.scene_list import read_lists
from fit_material.fitter.export.export import export
from fit_material.fitter.export.formats import FORMATS
from fit_material.fitter.result.schema import read_result
from fit_material.renderer.camera_files.mitsuba_sensors import read_sensors
from fit_material.renderer.camera_files.nerf_transforms import read_transforms
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import read_mesh
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.materials.mtl_reader import read_mtl
from fit_material.renderer.scene.scene_file import read_scene
from tests.fuzz.mutations import mutated
from tests.fuzz.seeds import MTL, OBJ, TRANSFORMS, seeds

SLOWEST = 5.0  # seconds for one input of at most 20 kB, on a machine that others use as well
SECRET = "secret.png"


@dataclass(frozen=True)
class Failure:
    """An input that was neither read nor refused."""

    kind: str
    number: int
    data: bytes
    what: str


def _exported(path: Path) -> None:
    """A result in all formats; what is Python among them is Python."""
    files = export(read_result(path), list(FORMATS), path.parent / "out", "ball", path)
    ast.parse(files[list(FORMATS).index("blender")].read_bytes())


def _listed(path: Path) -> None:
    """A list, but for what lies outside of its folder: the whole disk takes its time."""
    inside = re.sub(rb"\.\.|~", b"", path.read_bytes())
    path.write_bytes(re.sub(rb"(?<![\w.*\]])/", b"", inside))
    read_lists([str(path)])


READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "scene": ("scene.toml", read_scene),
    "transforms": ("transforms.json", lambda path: read_transforms(path, images=True)),
    "obj": ("ball.obj", read_mesh),
    "mtl": ("ball.mtl", read_mtl),
    "sensors": ("scene.xml", read_sensors),
    "result": ("result.json", _exported),
    "list": ("list.txt", _listed),
    "exr": ("view.exr", read_image),
    "hdr": ("view.hdr", read_image),
    "npy": ("view.npy", read_image),
    "png": ("view.png", read_image),
}
"""The name of a file of each kind, and what reads it."""


def prepared(folder: Path) -> Path:
    """A scene's folder with everything that the seeds name; beside it, outside of the tree, a picture."""
    tree = folder / "tree"
    tree.mkdir()
    exr, png = seeds("exr")[0], seeds("png")[0]
    for name, data in (("ball.obj", OBJ), ("ball.mtl", MTL), ("transforms.json", TRANSFORMS), ("inside.png", png)):
        (tree / name).write_bytes(data)
    for name in ("a", "deep/er"):
        (tree / name).mkdir(parents=True)
        (tree / name / "scene.toml").touch()
    for name in ("map.exr", "view.exr"):
        (tree / name).write_bytes(exr)
    (folder / SECRET).write_bytes(png)
    return tree


def fuzzed(kind: str, count: int, seed: int, tree: Path, first: int = 0) -> list[Failure]:
    """Inputs `first` … of a kind, each told by its number and the seed alone; those that were not taken well."""
    name, reader = READERS[kind]
    good, failures = seeds(kind), []
    for number in range(first, first + count):
        data = mutated(good, Random(f"{kind} {seed} {number}"))
        what = taken(reader, tree / name, data)
        if what is not None:
            failures.append(Failure(kind, number, data, what))
    return failures


def taken(reader: Callable[[Path], Any], path: Path, data: bytes) -> str | None:
    """What is wrong with how a reader takes an input; None where it reads or refuses it."""
    path.write_bytes(data)
    _opened.clear()
    begun = time.perf_counter()
    try:
        reader(path)
    except InputError as refusal:
        if "\n" in str(refusal) or len(str(refusal)) > 2000:
            return f"refuses it in more than a sentence: {str(refusal)[:200]!r}"
    except MemoryError:
        return "takes more memory than it may"
    except Exception as error:
        return f"raises {type(error).__name__}: {str(error)[:200]}"
    finally:
        seconds = time.perf_counter() - begun
    if any(Path(file).name == SECRET for file in _opened):
        return "opens a file outside of the scene's folder"
    return f"takes {seconds:.1f} s" if seconds > SLOWEST else None


_opened: list[str] = []


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open" and isinstance(arguments[0], str):
        _opened.append(arguments[0])


sys.addaudithook(_note)
