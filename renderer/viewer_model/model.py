"""A model as the viewer draws it: a mesh, and for each of its materials the numbers and the maps."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_bytes
from fit_material.renderer.geometry.mesh import UNNAMED, Mesh, faceted, read_mesh
from fit_material.renderer.geometry.obj import decoded, material_libraries
from fit_material.renderer.geometry.tangents import with_mirrored_apart
from fit_material.renderer.materials.mtl_reader import Dialect, Library, default_appearance, read_mtl
from fit_material.renderer.materials.mtl_syntax import found_file, spelled, written_names
from fit_material.renderer.materials.textured_material import Appearance, Maps


@dataclass(frozen=True)
class Model:
    """What is drawn.

    Attributes:
        mesh: with one or several objects, `mesh.part`.
        appearances: one for each of `mesh.material_names`, in their order.
        remarks: a sentence about everything that is not drawn as in the files.
        files: every file that was read, the mesh's first.
    """

    mesh: Mesh
    appearances: tuple[Appearance, ...]
    remarks: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()


def read_model(
    mesh: str | Path,
    mtl: str | Path | None = None,
    codes: Mapping[str, int] | None = None,
    dialect: Dialect = "auto",
    smooth: bool = True,
    outside: bool = False,
) -> Model:
    """Read a mesh, its materials and their textures.

    Materials go by the mesh's names for them, as they are or as our writer spells them. The only material of a file
    is also that of a mesh without names. One that is missing is matte, of color 0.6 and reflectance 1.

    Args:
        mesh: as for `read_mesh`.
        mtl: the materials; without it NAME.thesis.mtl beside the mesh, else the files that its `mtllib` lines name.
        codes, dialect: as for `read_mtl`.
        smooth: as for `read_mesh`.
        outside: read textures from anywhere, not only from the mesh's folder (or that of `mtl`) and below.

    Returns:
        The model. Under a normal map its mesh has vertex normals, and no vertex that two mirrored halves of a texture
        share; `renderer.geometry.tangents.tangents` is for that mesh.

    Raises:
        InputError: the mesh or an MTL file cannot be read.
    """
    path = Path(mesh)
    shape = read_mesh(path, smooth)
    files, missing = ([Path(mtl)], []) if mtl is not None else _material_files(path)
    tree = path.parent if mtl is None else Path(mtl).parent
    library = _joined([read_mtl(file, codes, dialect, tree, outside) for file in files])
    appearances, unknown = _assigned(path, shape.material_names, library)
    if shape.uv is None and any(appearance.maps != Maps() for appearance in appearances):
        unknown.append(str(InputError(path, expected="texture coordinates for its textures; drawn without them")))
        appearances = [Appearance(appearance.material) for appearance in appearances]
    if any(appearance.maps.normal is not None for appearance in appearances):
        shape = with_mirrored_apart(faceted(shape) if shape.normals is None else shape)
    remarks = (*missing, *library.remarks, *unknown)
    return Model(shape, tuple(appearances), tuple(dict.fromkeys(remarks)), tuple(dict.fromkeys((path, *library.files))))


def _material_files(path: Path) -> tuple[list[Path], list[str]]:
    """The MTL files that belong to a mesh, and a remark about each line whose file is not there."""
    own = path.with_suffix(".thesis.mtl")
    if own.is_file():
        return [own], []
    lines = material_libraries(decoded(read_bytes(path))) if path.suffix.lower() == ".obj" else []
    found = {line: _files_named(line, path.parent) for line in lines}
    expected = "a material file that exists; drawn without it"
    remarks = [str(InputError(path, "mtllib", line, expected)) for line in lines if not found[line]]
    return list(dict.fromkeys(file for files in found.values() for file in files)), remarks


def _files_named(line: str, folder: Path) -> list[Path]:
    """The files that a `mtllib` line names: one, blanks in its name or not, or several."""
    line = line.replace("\\ ", " ")
    whole = found_file(line, folder)
    if whole is not None:
        return [whole]
    return [file for name in file_names(line) if (file := found_file(name, folder)) is not None]


def file_names(line: str) -> list[str]:
    """The names in a `mtllib` line: up to each word that ends in ".mtl", behind the last of which every word is one."""
    end = max((found.end() for found in re.finditer(r"\.mtl(?!\S)", line, re.IGNORECASE)), default=0)
    return re.findall(r"\S.*?\.mtl(?!\S)|\S+", line[:end], re.IGNORECASE) + line[end:].split()


def _joined(libraries: list[Library]) -> Library:
    """All libraries in one; of two materials with one name the first."""
    appearances: dict[str, Appearance] = {}
    for library in libraries:
        appearances = {**library.appearances, **appearances}
    remarks = (remark for library in libraries for remark in library.remarks)
    return Library(appearances, tuple(remarks), tuple(file for library in libraries for file in library.files))


def _assigned(path: Path, names: Sequence[str], library: Library) -> tuple[list[Appearance], list[str]]:
    """The appearance of each of the mesh's materials, and a remark about each that the files lack."""
    known = library.appearances
    if len(known) == 1 and tuple(names) == (UNNAMED,):
        return list(known.values()), []
    keys = _keys(names, known)
    if not known:
        unknown = [str(InputError(path, expected="an MTL file with its materials; drawn matte"))]
    else:
        unknown = [_unknown(path, name) for name, key in zip(names, keys, strict=True) if key is None]
    return [default_appearance() if key is None else known[key] for key in keys], unknown


def _unknown(path: Path, name: str) -> str:
    if name == UNNAMED:
        return str(InputError(path, "usemtl", expected="a material for all faces; those without are drawn matte"))
    return str(InputError(path, "usemtl", name, "a material of that name in an MTL file; drawn matte"))


def _keys(names: Sequence[str], known: Mapping[str, Appearance]) -> list[str | None]:
    """What the files call each of the mesh's materials; None where they do not.

    Unless every name is there as it is, the file is taken for one of ours, whose names may be spelled otherwise.
    """
    if all(name in known for name in names):
        return list(names)
    spellings = zip(written_names(names), names, map(spelled, names), strict=True)
    return [next((name for name in spelling if name in known), None) for spelling in spellings]
