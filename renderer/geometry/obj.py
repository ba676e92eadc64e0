"""OBJ text made plain, so that no name, normal or index of a face is lost on the way through trimesh.

trimesh forgets a material's name where the MTL is missing or one of its colours has one number, and the
normals where only some faces of a material have them; relative indices it counts from the end of the file. So
it is given an equivalent file in one notation only: absolute indices, and a number for each material and
kind of face.
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain

MATERIAL_FILE = "materials"
_KINDS = ("v", "vt", "vn")
_OBJECT, _GROUP = "o", "g"

Group = tuple[str, tuple[str, ...], str]
"""What faces have in common: material, kinds that all corners refer to, object."""


@dataclass
class PlainObj:
    """Triangles and polygons of an OBJ file.

    Attributes:
        vertices: the lines of each kind (v, vt, vn), in their order.
        faces: the face lines, by material name, kinds that all corners refer to, and names of `o` and `g`.
        highest: the highest index used of each kind.
    """

    vertices: dict[str, list[str]] = field(default_factory=lambda: {kind: [] for kind in _KINDS})
    faces: dict[tuple[str, tuple[str, ...], tuple[str, str]], list[str]] = field(default_factory=dict)
    highest: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_KINDS, 0))

    @cached_property
    def groups(self) -> dict[Group, list[str]]:
        """The face lines by group; objects are named by `o`, or by `g` where `o` has one name only."""
        used = [{names[level] for _, _, names in self.faces} for level in (0, 1)]
        level = 1 if len(used[0]) == 1 < len(used[1]) else 0
        groups: dict[Group, list[str]] = {}
        for (material, kinds, names), lines in self.faces.items():
            groups.setdefault((material, kinds, names[level]), []).extend(lines)
        return groups

    @property
    def text(self) -> str:
        """The file anew, with the numbers of `groups` for materials' names."""
        lines = [f"mtllib {MATERIAL_FILE}", *chain.from_iterable(self.vertices.values())]
        for number, faces in enumerate(self.groups.values()):
            lines += [f"usemtl {number}", *faces]
        return "\n".join(lines)

    @property
    def material_text(self) -> str:
        """The material file that `text` refers to."""
        return "\n".join(f"newmtl {number}\nKd 1 1 1" for number in range(len(self.groups)))

    def add_face(self, material: str, names: tuple[str, str], corners: list[dict[str, int]]) -> None:
        shared = tuple(kind for kind in _KINDS if all(kind in corner for corner in corners))
        for kind in shared:
            self.highest[kind] = max(self.highest[kind], *(corner[kind] for corner in corners))
        separator = "//" if shared == ("v", "vn") else "/"
        line = " ".join(["f", *(separator.join(str(corner[kind]) for kind in shared) for corner in corners)])
        self.faces.setdefault((material, shared, names), []).append(line)

    def corner(self, word: str) -> dict[str, int]:
        """The absolute indices in "v/vt/vn", by kind.

        Raises:
            ValueError: not a number, 0, or relative to before the first vertex.
        """
        indices = {kind: int(part) for kind, part in zip(_KINDS, word.split("/"), strict=False) if part}
        for kind, index in indices.items():
            indices[kind] = index if index >= 0 else len(self.vertices[kind]) + 1 + index
            if indices[kind] <= 0:
                raise ValueError(f"{kind} index {index} of a face is out of range")
        return indices


def plain_obj(data: bytes, unnamed: str) -> PlainObj:
    """The triangles and polygons of an OBJ file.

    Args:
        data: the file; UTF-8, UTF-16 with byte-order mark, or Latin-1.
        unnamed: what to call the material of faces before the first `usemtl`, and their object before the first `o`.

    Raises:
        ValueError: an index that cannot be, or a vertex without its numbers.
    """
    text = decoded(data)
    lines = re.sub(r"\\\r?\n", " ", text).splitlines()
    missing = {*_KINDS[1:]} - {word for line in lines for word in line.split(maxsplit=1)[:1]}
    plain, material, named = PlainObj(), unnamed, {_OBJECT: unnamed, _GROUP: unnamed}
    for line in lines:
        key, *words = line.split() or [""]
        if key == "usemtl":
            material = " ".join(words) or unnamed
        elif key in named:
            named[key] = " ".join(words) or unnamed
        elif key in _KINDS:
            plain.vertices[key].append(_vertex(key, words))
        elif key == "f" and len(words := line.partition("#")[0].split()[1:]) >= 3:
            corners = [plain.corner(word) for word in words]
            # exporters refer to normals or texture coordinates that they did not write: the shape is whole
            kept = [{kind: i for kind, i in corner.items() if kind not in missing} for corner in corners]
            plain.add_face(material, (named[_OBJECT], named[_GROUP]), kept)
    return plain


def _vertex(key: str, words: list[str]) -> str:
    """A line of as many numbers as its kind has: trimesh takes its columns from all lines together."""
    if key == "vt":
        words = [*words, "0", "0"] if words else words  # the second is 0 where it is left out
    count = 2 if key == "vt" else 3
    if len(words) < count:
        raise ValueError(f"a line {' '.join([key, *words])!r} without {count} numbers")
    return " ".join([key, *words[:count]])


def material_libraries(text: str) -> list[str]:
    """What stands behind each `mtllib`, as written: one file's name or several."""
    return [name.strip() for name in re.findall(r"^[ \t]*mtllib[ \t]+(\S.*)$", text, re.MULTILINE)]


def decoded(data: bytes) -> str:
    """The text of an OBJ or MTL file: UTF-8, UTF-16 with byte-order mark, or Latin-1."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")
