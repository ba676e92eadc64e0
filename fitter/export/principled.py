"""A material in the terms that glTF's metallic-roughness model and Blender's Principled BSDF share."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fit_material.fitter.export.values import Rgb, front_color, given, index_and_tint, scattering_type
from fit_material.fitter.result.schema import FittedMaterial

WHITE: Rgb = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Principled:
    """A base under a dielectric surface, or a metal.

        field        mirror  body under a mirror       body alone
        base_color   F0      color                     color · reflectance
        metallic     1       0                         0
        roughness    √alpha  √alpha                    1
        specular     1       1                         0
        ior          1.5     of the largest channel    1.5
        tint         white   reflectance / largest     white

    Attributes:
        base_color: linear Rec. 709, in [0, 1].
        metallic: 0 or 1.
        perceptual_roughness: √alpha, in [0, 1].
        specular: weight of the dielectric's reflection, 0 or 1.
        ior: index of refraction of the dielectric, >= 1; the formats' default where there is none.
        tint: colour of the dielectric's reflection at normal incidence, in [0, 1].
    """

    base_color: Rgb
    metallic: float
    perceptual_roughness: float
    specular: float = 1.0
    ior: float = 1.5
    tint: Rgb = WHITE


def principled(material: FittedMaterial) -> Principled:
    """The material in those terms.

    Raises:
        ValueError: a number that they need is missing, not finite or out of range.
    """
    kind, color = scattering_type(material), front_color(material)
    if not kind.mirrors:
        return Principled(color, metallic=0.0, perceptual_roughness=1.0, specular=0.0)
    roughness = math.sqrt(given(material, "alpha"))
    if not kind.has_body:
        return Principled(color, metallic=1.0, perceptual_roughness=roughness)
    ior, tint = index_and_tint(given(material, "reflectance"))
    return Principled(color, metallic=0.0, perceptual_roughness=roughness, ior=ior, tint=tint)
