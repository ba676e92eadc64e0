"""GLB files that take more than they are, or that name other files."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import read_mesh

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")


def tree() -> dict:
    """One triangle, as glTF says it."""
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"name": "gold", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "picture.png"}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}],
        "bufferViews": [{"buffer": 0, "byteLength": CORNERS.nbytes}],
        "buffers": [{"byteLength": CORNERS.nbytes}],
    }


def write(path: Path, of: dict, data: bytes = CORNERS.tobytes()) -> Path:
    text = json.dumps(of).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data if data else b""
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


@pytest.fixture
def opened(monkeypatch) -> list[str]:
    """Names of the files that trimesh asks for beside the mesh."""
    names: list[str] = []

    def get(self, name: str) -> bytes:
        names.append(name)
        raise FileNotFoundError(name)

    monkeypatch.setattr(trimesh.resolvers.FilePathResolver, "get", get)
    return names


def test_no_picture_is_opened_and_the_materials_keep_their_names(tmp_path, opened):
    """A picture may be a pipe, or unpack to more than memory holds; of the mesh, only its shape is read."""
    mesh = read_mesh(write(tmp_path / "a.glb", tree()))
    np.testing.assert_array_equal(mesh.vertices[mesh.faces[0]], CORNERS)
    assert mesh.material_names == ("gold",)
    assert opened == []


def test_a_ply_opens_no_picture_either(tmp_path, opened):
    rows = "\n".join(" ".join(map(str, row)) for row in CORNERS.tolist())
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\ncomment TextureFile picture.png\nelement vertex 3\nproperty float x\nproperty float y\n"
        f"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n{rows}\n3 0 1 2\n"
    )
    assert len(read_mesh(tmp_path / "a.ply").faces) == 1
    assert opened == []


def zeros(of: dict) -> None:
    """An accessor without data is zeros [glTF 2.0, §3.6.2.1], here of 12 bytes each."""
    of["accessors"].append({"componentType": 5126, "type": "VEC3", "count": 10**12})


def negative(of: dict) -> None:
    """The same beside one that would make it less."""
    zeros(of)
    of["accessors"].append({"componentType": 5126, "type": "VEC3", "count": -(10**12)})


def views(of: dict) -> None:
    """Each is a copy of its piece of the buffer."""
    of["bufferViews"] += [{"buffer": 0, "byteLength": 10**9}] * 10**4


def primitives(of: dict) -> None:
    """Each has vertices of its own, of 24 bytes, and corners of 8."""
    of["accessors"][0]["count"] = 10**7
    of["meshes"][0]["primitives"] *= 10**4


def nodes(of: dict) -> None:
    of["accessors"][0]["count"] = 10**7
    of["nodes"] *= 10**4


@pytest.mark.parametrize(
    ("swell", "takes"),
    [(zeros, "1.2e+04"), (negative, "2.4e+04"), (views, "1e+04"), (primitives, "6.4e+03"), (nodes, "3.2e+03")],
)
def test_what_would_swell_is_refused_before_it_does(swell, takes, tmp_path):
    """Of primitives there are twice as many bytes: the mesh's, and its node's."""
    of = tree()
    swell(of)
    path = write(tmp_path / "a.glb", of)
    with pytest.raises(InputError) as refusal:
        read_mesh(path)
    sentence = f"{path}: expected what fits into memory: reading it takes {takes} GB, and "
    assert str(refusal.value).startswith(sentence)


def test_a_buffer_may_be_a_file_beside_the_mesh_and_none_elsewhere(tmp_path):
    folder = tmp_path / "model"
    folder.mkdir()
    of = tree()
    of["buffers"][0]["uri"] = "corners.bin"
    (folder / "corners.bin").write_bytes(CORNERS.tobytes())
    assert len(read_mesh(write(folder / "a.glb", of, b"")).faces) == 1
    (folder / "corners.bin").rename(tmp_path / "corners.bin")
    for name in ("../corners.bin", str(tmp_path / "corners.bin")):
        of["buffers"][0]["uri"] = name
        with pytest.raises(InputError) as refusal:
            read_mesh(write(folder / "a.glb", of, b""))
        expected = "a file in the mesh's folder or below it"
        assert str(refusal.value) == f"{folder / 'a.glb'}: buffers: is {name}, expected {expected}"
