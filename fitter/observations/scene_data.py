"""Everything that a scene file names, read and checked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fit_material.fitter.observations.album import Album
from fit_material.fitter.observations.material_maps import given_maps, shape_under
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.result.schema import InputFile
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.errors.printable import has_controls
from fit_material.renderer.files.digests import sha256_of
from fit_material.renderer.files.validation import PLAIN
from fit_material.renderer.geometry.mesh import Mesh, Shape
from fit_material.renderer.materials.textured_material import Maps
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import Tracer
from fit_material.renderer.rays.normal_mapping import with_relief
from fit_material.renderer.scene.input_paths import beside_photographs, input_paths
from fit_material.renderer.scene.scene_file import PhotographSpec, Scene, read_scene, read_shape
from fit_material.shaders.materials.kinds import KINDS, MaterialType


@dataclass(frozen=True)
class Loaded:
    """Everything that was read, but for the photographs, which are read when somebody looks at them.

    Attributes:
        name: of the output files: the mesh file's, or the shape's.
        materials: the names of the object's materials, in the mesh's order.
        files: those that were read, without the photographs'.
        repeated: which photographs are an earlier one once more.
        maps: those that the scene file names, of each material.
    """

    scene: Scene
    photographs: Album
    shape: Shape
    environment: Environment
    name: str
    materials: tuple[str, ...]
    files: tuple[InputFile, ...]
    repeated: frozenset[int] = frozenset()
    maps: tuple[Maps, ...] = ()

    def tracer(self) -> Tracer:
        """Of the shape under its normal maps."""
        normal = {index: each.normal for index, each in enumerate(self.maps) if each.normal is not None}
        return with_relief(gbuffer.tracer(self.shape), normal)

    @property
    def inputs(self) -> tuple[InputFile, ...]:
        """All files that are read, photographs and masks included."""
        return self.files + tuple(file for each in self.photographs.thumbnails for file in each.inputs)

    def kind(self, material: str, wanted: str) -> MaterialType | None:
        """The type to fit a material with: the scene file's word, else the one that is wanted; None for "auto"."""
        told = [spec.type for spec in self.scene.materials if spec.name == material and spec.type != "auto"]
        name = told[0] if told else wanted
        return name if name in KINDS else None


def load(scene_file: Path) -> Loaded:
    """Read and check a scene with its mesh and its light; photographs are read and checked one by one, later.

    Raises:
        InputError: a file or field is wrong, or needs what this version does not support.
    """
    scene = read_scene(scene_file)
    shape = read_shape(scene.geometry)
    names = _material_names(scene, shape, scene_file)
    light = scene.environment
    environment = read_environment(light.map, *light.start)
    stem = scene.geometry.mesh.stem if scene.geometry.mesh else str(scene.geometry.shape)
    photographs = Album.of_scene(scene.photographs, scene_file)
    files = _hashed(beside_photographs(scene, scene_file))
    maps = given_maps(scene.materials, shape, names, scene_file)
    shape = shape_under(shape, maps)
    return Loaded(scene, photographs, shape, environment, stem, names, files, repeated(scene.photographs), maps)


def repeated(photographs: Sequence[PhotographSpec]) -> frozenset[int]:
    """Which photographs have the bytes, the camera and the exposure of an earlier one.

    Their noise is the same noise: counted twice it would make errors smaller that nothing made smaller. Only files of
    one size are read for it.
    """
    sizes = [each.image.stat().st_size for each in photographs]
    seen: set[tuple[object, ...]] = set()
    found = []
    for index, (each, size) in enumerate(zip(photographs, sizes, strict=True)):
        if sizes.count(size) == 1:
            continue
        mask = sha256_of(each.mask) if each.mask else None
        key = (sha256_of(each.image), mask, each.model_dump_json(exclude={"image", "mask"}))
        found += [index] if key in seen else []
        seen.add(key)
    return frozenset(found)


def material_names(scene: Scene, scene_file: Path) -> tuple[str, ...]:
    """The names of the object's materials, in the mesh's order; reads the mesh, and nothing else."""
    return _material_names(scene, read_shape(scene.geometry), scene_file)


def _material_names(scene: Scene, shape: Shape, scene_file: Path) -> tuple[str, ...]:
    """The mesh's materials; a shape known by formula has one, of the name that the scene file gives it."""
    given = [spec.name for spec in scene.materials]
    repeated = next((name for i, name in enumerate(given) if name in given[:i]), None)
    if repeated is not None:
        raise InputError(scene_file, "materials", repeated, "each name once")
    if not isinstance(shape, Mesh):
        if len(given) > 1:
            raise InputError(scene_file, "materials", f"{len(given)} tables", "one: a sphere has one material")
        return (given[0] if given else "default",)
    for i, name in enumerate(given):
        if name not in shape.material_names:
            expected = f"the name of one of the mesh's materials: {', '.join(shape.material_names)}"
            raise InputError(scene_file, f"materials[{i}].name", name, expected)
    return shape.material_names


def input_files(scene: Scene, scene_file: Path) -> tuple[InputFile, ...]:
    """The files that a scene names, itself and its photographs among them, with their hashes."""
    return _hashed(input_paths(scene, scene_file))


def _hashed(paths: Iterable[Path | None]) -> tuple[InputFile, ...]:
    """Those that are files.

    Raises:
        InputError: a file cannot be read, or its path has control characters, which no result may have.
    """
    files = [path for path in paths if path is not None and path.is_file()]
    for path in files:
        if has_controls(str(path)):
            raise InputError(path, expected=f"a path {PLAIN}")
    return tuple(InputFile(path=str(path), sha256=sha256_of(path)) for path in files)


def kinds_of(loaded: Loaded, options: FitOptions) -> list[MaterialType | None]:
    """The type of each material where scene file or options give it."""
    return [loaded.kind(name, options.type) for name in loaded.materials]
