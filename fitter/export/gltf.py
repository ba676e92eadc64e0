"""Materials as glTF 2.0: a ball of each, which any viewer shows and any modeller takes the material from."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from fit_material.fitter.export.principled import WHITE, Principled, principled
from fit_material.fitter.result.schema import FittedMaterial

SUBDIVISIONS = 3  # of an icosahedron: 642 vertices, whose outline is 1 % off a circle's
SPACING = 2.5  # between the balls' centres, in radii
FLOAT, UNSIGNED_SHORT, VERTICES, INDICES = 5126, 5123, 34962, 34963  # glTF's words, from OpenGL

Json = dict[str, Any]


def gltf(materials: Sequence[FittedMaterial]) -> str:
    """The file's text: materials by `KHR_materials_ior` and `KHR_materials_specular`, buffers inside.

    What is known of each number goes into the material's `extras`.

    Raises:
        ValueError: a number that glTF needs is missing, not finite or out of range.
    """
    entries = [_material(material) for material in materials]
    extensions = sorted({name for entry in entries for name in entry.get("extensions", {})})
    content = {
        "asset": {"version": "2.0", "generator": "fit-material"},
        **({"extensionsUsed": extensions} if extensions else {}),
        "scene": 0,
        "scenes": [{"nodes": list(range(len(materials)))}],
        "nodes": [
            {"name": material.name, "mesh": i, "translation": [SPACING * i, 0.0, 0.0]}
            for i, material in enumerate(materials)
        ],
        "meshes": [{"primitives": [_primitive(i)]} for i in range(len(materials))],
        "materials": entries,
        **_ball(),
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _material(material: FittedMaterial) -> Json:
    look = principled(material)
    surface = {
        "baseColorFactor": [*look.base_color, 1.0],
        "metallicFactor": look.metallic,
        "roughnessFactor": look.perceptual_roughness,
    }
    extensions = {} if look.metallic else _dielectric(look)
    return {
        "name": material.name,
        "pbrMetallicRoughness": surface,
        **({"extensions": extensions} if extensions else {}),
        "extras": {"fit-material": material.model_dump(mode="json", exclude={"name"}, exclude_none=True)},
    }


def _dielectric(look: Principled) -> Json:
    """The surface over the base; F0 = ((η-1)/(η+1))² · specularColor [KHR_materials_specular]."""
    if look.specular == 0:
        return {"KHR_materials_specular": {"specularFactor": 0.0}}
    tint = {} if look.tint == WHITE else {"KHR_materials_specular": {"specularColorFactor": list(look.tint)}}
    return {"KHR_materials_ior": {"ior": look.ior}, **tint}


def _primitive(material: int) -> Json:
    """The ball in one material; on the unit sphere a normal is its own position."""
    return {"attributes": {"POSITION": 0, "NORMAL": 0}, "indices": 1, "material": material}


def _ball() -> Json:
    """Buffer, views and accessors of the unit sphere."""
    from trimesh.creation import icosphere

    sphere = icosphere(subdivisions=SUBDIVISIONS)
    positions, corners = sphere.vertices.astype("<f4"), sphere.faces.astype("<u2").ravel()
    data = positions.tobytes() + corners.tobytes()
    lows, highs = positions.min(0).tolist(), positions.max(0).tolist()
    return {
        "accessors": [
            {
                "bufferView": 0,
                "componentType": FLOAT,
                "count": len(positions),
                "type": "VEC3",
                "min": lows,
                "max": highs,
            },
            {"bufferView": 1, "componentType": UNSIGNED_SHORT, "count": len(corners), "type": "SCALAR"},
        ],
        "bufferViews": [_view(0, positions, VERTICES), _view(positions.nbytes, corners, INDICES)],
        "buffers": [{"byteLength": len(data), "uri": f"data:application/octet-stream;base64,{_base64(data)}"}],
    }


def _view(offset: int, part: np.ndarray, target: int) -> Json:
    return {"buffer": 0, "byteOffset": offset, "byteLength": part.nbytes, "target": target}


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
