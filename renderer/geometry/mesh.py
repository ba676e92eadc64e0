"""Shapes: triangle meshes read through trimesh, and the analytic unit sphere."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float, Int

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.errors.printable import has_controls, unicode_text
from fit_material.renderer.files.regular_files import read_bytes, require_file
from fit_material.renderer.files.validation import PLAIN, shortened
from fit_material.renderer.geometry.glb import other_files, plain_glb
from fit_material.renderer.geometry.obj import MATERIAL_FILE, plain_obj

UNNAMED = "default"
FARTHEST = 1e75  # of coordinates: squares of areas stay finite
logging.getLogger("trimesh").addHandler(logging.NullHandler())  # without a handler, Python prints a library's warnings


@dataclass(frozen=True)
class Sphere:
    """The analytic unit sphere at the origin: exact normals, no facets."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in world space, +Y up.

    Attributes:
        vertices: positions, float64.
        faces: three vertex indices per triangle, counter-clockwise from outside.
        normals: unit vertex normals for smooth shading, or None where the mesh is to be shaded by its facets.
        uv: texture coordinates per vertex, or None.
        material: index into `material_names` per face.
        material_names: the `usemtl` names; one entry, "default", where the file names none.
        part: index into `part_names` per face; None where the mesh is one object.
        part_names: the objects of the file: an OBJ's `o` (else `g`), a GLB's nodes.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normals: Float[np.ndarray, "v 3"] | None
    uv: Float[np.ndarray, "v 2"] | None
    material: Int[np.ndarray, " f"]
    material_names: tuple[str, ...] = (UNNAMED,)
    part: Int[np.ndarray, " f"] | None = None
    part_names: tuple[str, ...] = (UNNAMED,)


Shape = Sphere | Mesh


@dataclass(frozen=True)
class _Part:
    """Triangles of one material and one object, in world space."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normals: Float[np.ndarray, "v 3"] | None
    uv: Float[np.ndarray, "v 2"] | None
    name: str
    object: str


Triangles = TypeVar("Triangles", _Part, Mesh)


def read_mesh(path: str | Path, smooth: bool = True) -> Mesh:
    """Read a triangle mesh; polygons are split into triangles and triangles without area dropped.

    Only the geometry and the materials' names are read: a missing or broken MTL file or texture does no harm.

    Args:
        path: .obj, .ply, .stl or .glb; the nodes of a scene are placed by their transforms.
        smooth: keep the vertex normals that the file has; parts without stay faceted.

    Raises:
        InputError: the file is missing or unreadable, has no triangle with an area, an index out of range, or
            a vertex that is not finite.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise InputError(path, "format", path.suffix or "missing", f"one of {' '.join(FORMATS)}")
    require_file(path, "a mesh file")
    parts = [_without_slivers(part) for part in _parts(path)]
    parts = [part for part in parts if len(part.faces)]
    if not parts:
        raise InputError(path, "faces", 0, "at least one triangle with an area")
    return _joined(parts, smooth)


def _parts(path: Path) -> list[_Part]:
    """Every triangle mesh in the file, checked."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of numpy, about trimesh's way to read numbers
            parts = list(_READERS[path.suffix.lower()](path))
    except InputError:
        raise
    except ImportError as error:  # trimesh looks for a package that guesses how text is encoded, which this is not
        raise InputError(path, expected=f"a readable {path.suffix[1:].upper()} mesh") from error
    except Exception as error:  # trimesh raises whatever its parsers run into
        reason = f"{error}".partition("\n")[0].strip().rstrip(".") or type(error).__name__
        raise InputError(
            path, expected=f"a readable {path.suffix[1:].upper()} mesh ({shortened(reason, 200)})"
        ) from error
    for part in parts:
        _check(path, part)
    return parts


def _check(path: Path, part: _Part) -> None:
    for what, name in (("name of a material", part.name), ("name of an object", part.object)):
        if has_controls(name):  # it goes to terminals, and into files where a line break ends a name
            raise InputError(path, what, shortened(name), f"one {PLAIN}")
    if part.vertices.ndim != 2 or part.vertices.shape[1] != 3 or part.faces.ndim != 2 or part.faces.shape[1] != 3:
        raise InputError(path, expected="vertices of three coordinates and faces of three corners")
    if part.faces.size and not 0 <= part.faces.min() <= part.faces.max() < len(part.vertices):
        outside = part.faces[(part.faces < 0) | (part.faces >= len(part.vertices))][0]
        raise InputError(path, "vertex index of a face", outside, f"less than {len(part.vertices)}")
    broken = ~(np.abs(part.vertices) <= FARTHEST).all(-1)  # nan is, too
    if broken.any():
        raise InputError(path, "vertices", part.vertices[broken][0].tolist(), "finite coordinates")


def _plain_parts(path: Path) -> Iterator[_Part]:
    return _scene_parts(_load(read_bytes(path), path.suffix[1:].lower(), {}))


def _load(data: bytes, file_type: str, others: Mapping[str, bytes]) -> Any:
    """A file as trimesh has it, which opens none: `others` are those that may be named in it."""
    import trimesh

    return trimesh.load_scene(BytesIO(data), file_type=file_type, resolver=dict(others), process=False)


def _scene_parts(scene: Any) -> Iterator[_Part]:
    """The scene's triangle meshes, moved by their nodes' transforms."""
    for node in scene.graph.nodes_geometry:
        transform, key = scene.graph[node]
        geometry = scene.geometry[key]
        if hasattr(geometry, "faces"):  # neither a point cloud nor a path
            yield _part(geometry, np.asarray(transform, np.float64), _object(scene, node, geometry))


def _object(scene: Any, node: str, geometry: Any) -> str:
    """The node's name in the file; trimesh makes a node of its own for each material of a GLB's node."""
    return scene.graph.transforms.parents[node] if geometry.metadata.get("from_gltf_primitive") else node


def _part(geometry: Any, transform: Float[np.ndarray, "4 4"], node: str) -> _Part:
    vertices, linear = np.asarray(geometry.vertices, np.float64), transform[:3, :3]
    if not np.array_equal(transform, np.eye(4)):  # which would spread a NaN over the coordinates
        vertices = vertices @ linear.T + transform[:3, 3]
    mirrored = np.linalg.det(linear) < 0
    faces = np.asarray(geometry.faces, np.int64)
    normals = geometry._cache["vertex_normals"]  # the public property makes them up where the file has none
    uv = getattr(geometry.visual, "uv", None)
    material = getattr(geometry.visual, "material", None)
    return _Part(
        vertices=vertices,
        faces=faces[:, ::-1] if mirrored else faces,
        normals=None if normals is None else _unit_normals(normals @ np.linalg.inv(linear)),
        uv=_finite_uv(uv, len(vertices)),
        name=unicode_text(str(getattr(material, "name", None) or UNNAMED)),  # JSON may hold what no file of ours can
        object=unicode_text(str(node)),
    )


def _finite_uv(uv: Any, count: int) -> Float[np.ndarray, "v 2"] | None:
    """Texture coordinates; None where vertices have none, or one that is no number."""
    if uv is None or len(uv) != count or not np.isfinite(uv).all():
        return None
    return np.asarray(uv, np.float64)[:, :2]


def _unit_normals(normals: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"] | None:
    """Normals of unit length; None where one of them has no direction."""
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    if not (np.isfinite(length).all() and (length > 0).all()):
        return None
    return normals / length


def _without_slivers(part: _Part) -> _Part:
    """The part without its triangles of no area, whose normal is only rounding."""
    if not len(part.faces):
        return part
    corner = part.vertices[part.faces]
    area = np.linalg.norm(_doubled_area(corner), axis=-1)
    extent = np.ptp(corner.reshape(-1, 3), axis=0)
    kept = area > 1e-12 * (extent @ extent)
    return replace(part, faces=part.faces[kept])


def _doubled_area(corner: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "f 3"]:
    """Normal of each triangle, twice its area long."""
    return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])


def _joined(parts: list[_Part], smooth: bool) -> Mesh:
    """One mesh of all parts; where some have normals, the others get those of their facets, and uv 0 likewise."""
    smooth = smooth and any(part.normals is not None for part in parts)
    if smooth:
        parts = [part if part.normals is not None else faceted(part) for part in parts]
    names, objects = (tuple(dict.fromkeys(found)) for found in zip(*((p.name, p.object) for p in parts), strict=True))
    offset = np.cumsum([0, *(len(part.vertices) for part in parts)])
    uv = [np.zeros((len(part.vertices), 2)) if part.uv is None else part.uv for part in parts]
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([part.faces + start for part, start in zip(parts, offset, strict=False)]),
        normals=np.concatenate([part.normals for part in parts if part.normals is not None]) if smooth else None,
        uv=np.concatenate(uv) if any(part.uv is not None for part in parts) else None,
        material=_per_face(parts, [names.index(part.name) for part in parts]),
        material_names=names,
        part=_per_face(parts, [objects.index(part.object) for part in parts]) if len(objects) > 1 else None,
        part_names=objects if len(objects) > 1 else (UNNAMED,),
    )


def _per_face(parts: list[_Part], index: list[int]) -> Int[np.ndarray, " f"]:
    return np.repeat(index, [len(part.faces) for part in parts])


def faceted(part: Triangles) -> Triangles:
    """The triangles with three vertices of their own each, which bear the facet's normal."""
    corner = part.vertices[part.faces]
    normal = _doubled_area(corner)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return replace(
        part,
        vertices=corner.reshape(-1, 3),
        faces=np.arange(corner.shape[0] * 3).reshape(-1, 3),
        normals=np.repeat(normal, 3, axis=0),
        uv=None if part.uv is None else part.uv[part.faces].reshape(-1, 2),
    )


def _obj_parts(path: Path) -> Iterator[_Part]:
    plain = plain_obj(read_bytes(path), UNNAMED)
    for kind, lines in plain.vertices.items():
        if plain.highest[kind] > len(lines):
            raise InputError(path, f"{kind} index of a face", plain.highest[kind], f"at most {len(lines)}")
    if not plain.faces:
        return
    groups = list(plain.groups)
    materials = {MATERIAL_FILE: plain.material_text.encode()}
    for part in _scene_parts(_load(plain.text.encode(), "obj", materials)):
        name, _, object_ = groups[int(part.name)]
        yield replace(part, name=name, object=object_)


def _glb_parts(path: Path) -> Iterator[_Part]:
    data = plain_glb(path)
    return _scene_parts(_load(data, "glb", other_files(path, data)))


_READERS = {".obj": _obj_parts, ".ply": _plain_parts, ".stl": _plain_parts, ".glb": _glb_parts}
FORMATS = tuple(_READERS)
