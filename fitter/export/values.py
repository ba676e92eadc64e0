"""A material's numbers and name as the files of other programs take them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

import torch

from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.errors.printable import printable
from fit_material.renderer.materials.mtl_syntax import FLOAT32_MAX, distinct
from fit_material.shaders.materials.kinds import KINDS, Kind
from fit_material.shaders.optics.fresnel import index_limit

Rgb = tuple[float, float, float]


def scattering_type(material: FittedMaterial) -> Kind:
    """The material's type, which mirrors, or has a body, or both.

    Raises:
        ValueError: it does neither, and no format has an entry for that.
    """
    kind = KINDS[material.type]
    if not kind.mirrors and not kind.has_body:
        raise ValueError(f"{material.type} {material.name!r} neither mirrors nor has a body, and no format holds that")
    return kind


def given(material: FittedMaterial, parameter: str) -> Any:
    """The material's number, or three numbers, which a format needs.

    Raises:
        ValueError: it has none, or one that is not finite or beyond float32.
    """
    value = getattr(material, parameter)
    if value is None:
        raise ValueError(f"{material.type} {material.name!r} has no {parameter}, which its file needs")
    for each in value if isinstance(value, tuple) else (value,):
        number(each)
    return value


def number(value: float) -> str:
    """A number as text, `%.9g`, which gives every float32 back exactly.

    Raises:
        ValueError: it is not finite, or beyond float32.
    """
    if not abs(value) <= FLOAT32_MAX:  # nan compares false
        raise ValueError(f"{value} cannot be exported: expected a finite number of float32's range")
    return f"{value:.9g}"


def numbers(values: Iterable[float], between: str = " ") -> str:
    """Several numbers as `number` writes them."""
    return between.join(map(number, values))


def front_color(material: FittedMaterial) -> Rgb:
    """The colour of the body seen from the front, linear Rec. 709.

        mirror without a body    F0
        body under a mirror      color
        body alone               color · reflectance

    Raises:
        ValueError: one of these is missing, not finite or beyond float32.
    """
    kind = scattering_type(material)
    if not kind.has_body:
        return given(material, "f0")
    color = given(material, "color")
    if kind.mirrors:
        return color
    red, green, blue = (each * f for each, f in zip(color, given(material, "reflectance"), strict=True))
    return red, green, blue


def index_and_tint(reflectance: Sequence[float]) -> tuple[float, Rgb]:
    """The index of refraction and colour of a surface of that reflectance at normal incidence.

    Args:
        reflectance: F0 per channel, in [0, 1).

    Returns:
        η >= 1 with ((η-1)/(η+1))² = max F0, and F0 over its largest channel; white where nothing reflects.

    Raises:
        ValueError: a channel is 1, which no finite index makes.
    """
    largest = max(reflectance)
    if largest >= 1:
        raise ValueError(f"a reflectance of {largest:.9g} has no index of refraction: expected one below 1")
    if largest == 0:
        return 1.0, (1.0, 1.0, 1.0)
    red, green, blue = (f / largest for f in reflectance)
    return float(index_limit(torch.tensor(largest, dtype=torch.float64))), (red, green, blue)


def remark_line(remark: str) -> str:
    """A remark as a comment takes it, in Python and in XML: one line, that ends no comment and has no -- in it."""
    return re.sub("-(?=-)", "- ", printable(remark))


def identifiers(names: Iterable[str]) -> list[str]:
    """The names as XML formats take them: ASCII letters, digits and single _, no digit first, no two the same."""
    return distinct([re.sub(r"[\W_]+|^(?=\d|$)", "_", name, flags=re.ASCII) for name in names])
