"""Materials as a Python script for Blender 4, which sets the values of Principled BSDFs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import torch

from fit_material.fitter.export.principled import principled
from fit_material.fitter.export.values import Rgb, given, number, numbers, remark_line
from fit_material.fitter.result.formatting import remarks
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.shaders.materials.quantities import F0, INDEX
from fit_material.shaders.optics.fresnel import conductor, schlick

HEAD = '''"""Materials that fit-material found, for Blender 4: run it in its Scripting workspace, or by --python.

A material of that name is changed, one that is missing is made. Colours are linear Rec. 709.
"""

import bpy

MATERIALS = {'''

TAIL = """}

for name, values in MATERIALS.items():
    material = bpy.data.materials.get(name) or bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    principled = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    for socket, value in values.items():
        principled.inputs[socket].default_value = value
"""

F82_COSINE = 1 / 7  # of the angle, 82°, at which Blender's metals take their tint


def blender(materials: Sequence[FittedMaterial]) -> str:
    """The script's text, errors in comments.

    Raises:
        ValueError: a number that a socket needs is missing, not finite or out of range.
    """
    return "\n".join([HEAD, *(line for material in materials for line in _entry(material)), TAIL])


def _entry(material: FittedMaterial) -> Iterator[str]:
    yield f"    {material.name!a}: {{"
    yield from (f"        # {remark_line(remark)}" for remark in remarks(material))
    yield from (f'        "{socket}": {value},' for socket, value in _sockets(material).items())
    yield "    },"


def _sockets(material: FittedMaterial) -> Mapping[str, str]:
    """Values by the names that Principled BSDF's sockets have since Blender 4.0."""
    look = principled(material)
    return {
        "Base Color": _color(look.base_color),
        "Metallic": number(look.metallic),
        "Roughness": number(look.perceptual_roughness),
        "IOR": number(look.ior),
        "Specular IOR Level": number(look.specular / 2),  # ½ leaves the reflectance as the IOR has it
        "Specular Tint": _color(f82_tint(material) if look.metallic else look.tint),
    }


def _color(value: Rgb) -> str:
    return f"({numbers(value, ', ')}, 1.0)"


def f82_tint(material: FittedMaterial) -> Rgb:
    """What Blender multiplies Schlick's reflectance of a metal by at cos θ = 1/7, so that its curve follows n and k.

        t = F(1/7; n, k) / schlick(1/7; F0), at most 1        [Kutz 2021, Adobe Standard Material, on F82]

    Returns:
        t per channel, in [0, 1].
    """
    n, k, f0 = (torch.tensor(given(material, key), dtype=torch.float64) for key in (*INDEX, F0.name))
    cosine = torch.tensor(F82_COSINE, dtype=torch.float64)
    red, green, blue = (conductor(cosine, n, k) / schlick(cosine, f0)).clamp(0, 1).tolist()
    return red, green, blue
