"""GLB files made plain, so that trimesh makes shapes of them and nothing else: no pictures, and no more than fits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from fit_material.renderer.compute.memory import require_memory
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_bytes
from fit_material.renderer.files.validation import existing_file

COMPRESSIONS = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
HEADER = 20  # bytes: magic, version, length of all; length and type of the JSON chunk [glTF 2.0, §4.4]
COMPONENTS = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # bytes
ELEMENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
VERTEX, CORNER = 3 * 8, 8  # bytes in trimesh's meshes

Tree = dict[str, Any]


def plain_glb(path: Path) -> bytes:
    """The file without its pictures, and of its materials their names alone.

    Raises:
        InputError: its meshes are compressed, which trimesh reads as zeros without a decoder, or do not fit into
            memory: an accessor without data is zeros, as many as it likes, and parts may be used without end.
        ValueError, KeyError, …: it is no such file.
    """
    data = read_bytes(path)
    end = HEADER + int.from_bytes(data[12:16], "little")
    tree = json.loads(data[HEADER:end])
    compressed = COMPRESSIONS & {*tree.get("extensionsRequired", [])}
    if compressed:
        raise InputError(path, "extensionsRequired", ", ".join(compressed), "meshes that are not compressed")
    require_memory(path, _bytes(tree))
    kept = {key: value for key, value in tree.items() if key not in ("images", "textures", "samplers")}
    if "materials" in tree:
        kept["materials"] = [{key: each[key] for key in each.keys() & {"name"}} for each in tree["materials"]]
    text = json.dumps(kept).encode()
    text += b" " * (-len(text) % 4)
    lengths = (HEADER + len(text) + len(data[end:]), len(text))
    whole, chunk = (length.to_bytes(4, "little") for length in lengths)
    return data[:8] + whole + chunk + data[16:HEADER] + text + data[end:]


def other_files(path: Path, glb: bytes) -> dict[str, bytes]:
    """The files beside or below it that a plain GLB takes buffers from, by the names that it has for them."""
    tree = json.loads(glb[HEADER : HEADER + int.from_bytes(glb[12:16], "little")])
    names = [each["uri"] for each in tree.get("buffers", []) if not each.get("uri", "data:").startswith("data:")]
    return {name: read_bytes(_inside(path, name)) for name in names}


def _inside(path: Path, name: str) -> Path:
    file = existing_file(name, path.parent)
    if file is None or not file.resolve().is_relative_to(path.parent.resolve()):
        raise InputError(path, "buffers", name, "a file in the mesh's folder or below it")
    return file


def _bytes(tree: Tree) -> int:
    """What trimesh takes for a file at least; negative lengths, which it refuses later, make that no smaller."""
    views = sum(abs(each["byteLength"]) for each in tree.get("bufferViews", []))
    counts = [abs(each["count"]) for each in tree.get("accessors", [])]
    each_takes = [COMPONENTS[each["componentType"]] * ELEMENTS[each["type"]] for each in tree.get("accessors", [])]
    meshes = [sum(_of_primitive(each, counts) for each in mesh["primitives"]) for mesh in tree.get("meshes", [])]
    nodes = sum(meshes[node["mesh"]] for node in tree.get("nodes", []) if "mesh" in node)
    return views + sum(count * takes for count, takes in zip(counts, each_takes, strict=True)) + sum(meshes) + nodes


def _of_primitive(primitive: Tree, counts: list[int]) -> int:
    vertices = counts[primitive["attributes"]["POSITION"]]
    corners = counts[primitive["indices"]] if "indices" in primitive else vertices
    return vertices * VERTEX + corners * CORNER
