"""A material in the terms that glTF's metallic-roughness model and Blender's Principled BSDF share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from fit_material.fitter.export.values import Rgb, front_color, given, index_and_tint
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.shaders.materials.kinds import MaterialType

WHITE: Rgb = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Principled:
    """A base under a dielectric surface, or a metal.

        field        metal   glossy                    matte
        base_color   F0      color                     color · reflectance
        metallic     1       0                         0
        roughness    √alpha  √alpha                    1
        specular     1       1                         0
        ior          1.5     of the largest channel    1.5
        tint         white   reflectance / largest     white

    Attributes:
        base_color: linear Rec. 709, in [0, 1].
        metallic: 0 or 1.
        roughness: perceptual, √alpha, in [0, 1].
        specular: weight of the dielectric's reflection, 0 or 1.
        ior: index of refraction of the dielectric, >= 1; the formats' default where there is none.
        tint: colour of the dielectric's reflection at normal incidence, in [0, 1].
    """

    base_color: Rgb
    metallic: float
    roughness: float
    specular: float = 1.0
    ior: float = 1.5
    tint: Rgb = WHITE


def principled(material: FittedMaterial) -> Principled:
    """The material in those terms.

    Raises:
        ValueError: a number that they ask for is missing, not finite or out of range.
    """
    return _PRINCIPLED[material.type](material)


def _metal(material: FittedMaterial) -> Principled:
    return Principled(front_color(material), metallic=1.0, roughness=_roughness(material))


def _glossy(material: FittedMaterial) -> Principled:
    color, roughness = front_color(material), _roughness(material)
    ior, tint = index_and_tint(given(material, "reflectance"))
    return Principled(color, metallic=0.0, roughness=roughness, ior=ior, tint=tint)


def _matte(material: FittedMaterial) -> Principled:
    return Principled(front_color(material), metallic=0.0, roughness=1.0, specular=0.0)


_PRINCIPLED: Mapping[MaterialType, Callable[[FittedMaterial], Principled]] = {
    "metal": _metal,
    "glossy": _glossy,
    "matte": _matte,
}


def _roughness(material: FittedMaterial) -> float:
    return math.sqrt(given(material, "alpha"))
