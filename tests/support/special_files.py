"""Every reader on a pipe and on /dev/zero, each for some seconds at most; prints what they say. Run as a program.

python -m tests.support.special_files FOLDER
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

SECONDS = 5
MEMORY = 8 << 30

SCENE = """
cameras = "{cameras}"
geometry.mesh = "{mesh}"
environment.map = "{map}"
materials = [{{ name = "a", normal_map = "{texture}" }}]
[[photographs]]
image = "{image}"
mask = "{mask}"
camera = {{ origin = [0, 0, 3], target = [0, 0, 0] }}
"""
KEYS = ("cameras", "mesh", "map", "texture", "image", "mask")

COLMAP = "1 PINHOLE 4 4 1 1 2 2\n"


def readers() -> Iterator[tuple[str, str, Callable[[Path], Any]]]:
    """What reads a file, and the file's name."""
    from fit_material.fitter.batch.scene_list import read_lists
    from fit_material.fitter.frontier.errors import truth_beside
    from fit_material.fitter.result.schema import read_result
    from fit_material.renderer.camera_files.importers import read_cameras
    from fit_material.renderer.environment.environment_file import read_environment
    from fit_material.renderer.files.digests import sha256_of
    from fit_material.renderer.geometry.mesh import read_mesh
    from fit_material.renderer.images.exif import relative_exposure
    from fit_material.renderer.images.image_file import read_image
    from fit_material.renderer.images.samples import FORMATS
    from fit_material.renderer.images.textures import read_texture
    from fit_material.renderer.materials.mtl_reader import read_mtl
    from fit_material.renderer.scene.scene_file import read_scene

    yield from ((f"image {ending}", f"a{ending}", read_image) for ending in FORMATS)
    yield from ((f"mesh {ending}", f"a{ending}", read_mesh) for ending in (".obj", ".ply", ".stl", ".glb"))
    yield "texture", "a.gif", lambda path: read_texture(path, color=True)
    yield "environment", "a.exr", read_environment
    yield "exposure", "a.jpg", relative_exposure
    yield "materials", "a.mtl", read_mtl
    yield "scene", "scene.toml", read_scene
    yield "transforms", "transforms.json", lambda path: read_cameras(path, None)
    yield "sensors", "sensors.xml", lambda path: read_cameras(path, [])
    yield "result", "result.json", read_result
    yield "hash", "a", sha256_of
    yield "truth", "truth.json", truth_beside
    yield "list", "list.txt", lambda path: read_lists([str(path)])
    yield "colmap", "images.txt", _colmap
    yield from ((f"scene's {key}", f"a-{key}.png", _scene_with(key)) for key in KEYS)


def _colmap(path: Path) -> Any:
    from fit_material.renderer.camera_files.importers import read_cameras

    (path.parent / "cameras.txt").write_text(COLMAP)
    return read_cameras(path.parent, None)


def _scene_with(key: str) -> Callable[[Path], Any]:
    """A scene of which that one key names the file, and the others one that is whole."""
    from fit_material.renderer.scene.scene_file import read_scene

    def read(path: Path) -> Any:
        regular = path.with_name("regular.png")
        regular.touch()
        scene = path.with_name("scene.toml")
        scene.write_text(SCENE.format(**{**dict.fromkeys(KEYS, regular.name), key: path.name}))
        if key != "cameras":
            scene.write_text("\n".join(line for line in scene.read_text().splitlines() if "cameras" not in line))
        return read_scene(scene)

    return read


def said(read: Callable[[Path], Any], path: Path) -> str:
    """How a reader ends."""
    from fit_material.renderer.errors.input_error import InputError

    signal.alarm(SECONDS)
    try:
        read(path)
    except InputError as refusal:
        return str(refusal)
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    return "was read"


def _too_late(*_: Any) -> None:
    raise TimeoutError("still reading")


def main(folder: Path) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGALRM, _too_late)
    found = {}
    for kind, make in (("pipe", os.mkfifo), ("zero", lambda path: os.symlink("/dev/zero", path))):
        for number, (name, file, read) in enumerate(readers()):
            path = folder / kind / str(number) / file
            path.parent.mkdir(parents=True)
            make(path)
            found[f"{name} {kind}"] = said(read, path).replace(f"{path.parent}/", "")
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
