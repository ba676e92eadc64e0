"""The PNG files of recovered textures: their names, known before a fit, and their bytes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fit_material.fitter.fitted.color_texture import codes
from fit_material.fitter.fitted.part import FittedPart
from fit_material.fitter.result.schema import Maps
from fit_material.renderer.images.image_file import png


def map_names(stem: str, materials: Sequence[str], index: int) -> Maps:
    """The files of a material's maps, of which a scene has those materials."""
    base = _file_name(stem if len(materials) == 1 else f"{stem}_{index}_{materials[index]}")
    return Maps(color=f"{base}_color.png", color_seen=f"{base}_color_seen.png")


def _file_name(text: str) -> str:
    """Without what readers of MTL files take for something else."""
    return re.sub(r"[^\w.-]+", "_", text, flags=re.ASCII).strip("_.") or "material"


def with_map_names(parts: Sequence[FittedPart], stem: str) -> list[FittedPart]:
    """The parts, each material of which names the files of its maps if it has any."""
    materials = [part.material.name for part in parts]

    def named(part: FittedPart) -> FittedPart:
        if part.color_map is None:
            return part
        names = map_names(stem, materials, part.index)
        return replace(part, material=part.material.model_copy(update={"maps": names}))

    return [named(part) for part in parts]


def map_files(parts: Sequence[FittedPart]) -> dict[str, bytes]:
    """The files of every part that has maps, by the names in its material.

    The PNG of colours has 8 bits in sRGB, which is what every reader of `map_Kd` takes it for; the other one's values
    are numbers of photographs.
    """
    files: dict[str, bytes] = {}
    for part in parts:
        names, made = part.material.maps, part.color_map
        if names is not None and made is not None:
            files[names.color] = png(codes(made.color))
            files[names.color_seen] = png(np.minimum(made.photographs, 255).astype(np.uint8))
    return files
