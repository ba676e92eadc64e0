"""Materials as a Mitsuba scene file, for other scenes to `include` and refer to by name."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Comment, Element, SubElement

from fit_material.fitter.export.values import (
    front_color,
    given,
    identifiers,
    index_and_tint,
    number,
    numbers,
    remark_line,
    scattering_type,
)
from fit_material.fitter.result.formatting import remarks
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.materials.bsdf import Bsdf, conductor, diffuse, plastic


def mitsuba_xml(materials: Sequence[FittedMaterial]) -> str:
    """The file's text: a `roughconductor`, `roughplastic` or `diffuse` each, its `id` the material's name.

    Raises:
        ValueError: a number that the BSDF needs is missing, not finite or out of range.
    """
    root = Element("scene", version="3.0.0")
    names = identifiers(material.name for material in materials)
    for name, material in zip(names, materials, strict=True):
        bsdf = _bsdf(material)
        node = SubElement(root, "bsdf", type=bsdf.pop("type"), id=name)
        node.extend(Comment(f" {remark_line(line)} ") for line in remarks(material))
        for key, value in bsdf.items():
            _add(node, key, value)
    ElementTree.indent(root)
    return ElementTree.tostring(root, "unicode", xml_declaration=True) + "\n"


def _bsdf(material: FittedMaterial) -> Bsdf:
    """The conductor, the coated body or the diffuse body that the material is."""
    kind = scattering_type(material)
    if not kind.mirrors:
        return diffuse(front_color(material))
    alpha = given(material, "alpha")
    if not kind.has_body:
        return conductor(given(material, "n"), given(material, "k"), alpha)
    reflectance = given(material, "reflectance")
    _, tint = index_and_tint(reflectance)
    surface = plastic(front_color(material), max(reflectance), alpha)
    return {**surface, "specular_reflectance": {"type": "rgb", "value": tint}}


def _add(node: Element, key: str, value: object) -> None:
    """A parameter as Mitsuba's XML has it: an element called after its type."""
    if isinstance(value, dict):
        SubElement(node, value["type"], name=key, value=numbers(value["value"]))
    elif isinstance(value, bool):  # before numbers, of which it is one
        SubElement(node, "boolean", name=key, value=str(value).lower())
    elif isinstance(value, float):
        SubElement(node, "float", name=key, value=number(value))
    else:
        SubElement(node, "string", name=key, value=str(value))
