"""The files of a fit, by name, before there is one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fit_material.fitter.export.formats import FORMATS
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.map_files import map_names
from fit_material.fitter.result.written_files import PICTURES, RESULT, TRANSFORMS, replaceable_by_fit
from fit_material.renderer.files.atomic import require_names
from fit_material.renderer.files.replaceable import Replaceable
from fit_material.renderer.scene.input_paths import input_paths

EXPORTED = ("mtl", "thesis")  # formats that every fit writes
SIZE = 4_000_000  # bytes of a fit's files without maps, or about so many


def output_names(name: str, materials: Sequence[str], options: FitOptions) -> list[str]:
    """What a fit may write.

    Args:
        name: of the scene's shape, which files are called after.
        materials: the names of the shape's.
    """
    exported = [f"{name}{FORMATS[each].ending}" for each in EXPORTED]
    maps = [map_names(name, materials, index) for index in range(len(materials))] if options.maps else []
    moved = [f"{name}{TRANSFORMS}"] if options.refine_pose else []
    return [RESULT, *PICTURES, *exported, *moved, *(file for each in maps for file in (each.color, each.color_seen))]


def require_room_for_outputs(loaded: Loaded, scene_file: Path, folder: Path, options: FitOptions) -> Replaceable:
    """What a fit of that scene may replace in that folder, of which it is known by now that this is enough.

    Raises:
        InputError: a file that is to be written would be an input, or of somebody else, or its name is too long.
    """
    names = output_names(loaded.name, loaded.materials, options)
    mesh = loaded.scene.geometry.mesh
    require_names(folder, names, str(mesh or loaded.name))
    allowed = replaceable_by_fit(folder, input_paths(loaded.scene, scene_file))
    allowed.require(folder, names)
    return allowed
