"""Materials as MaterialX 1.39: physically based nodes, with n and k of metals as they were found."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from fit_material.fitter.export.values import (
    front_color,
    given,
    identifiers,
    index_and_tint,
    number,
    numbers,
    scattering_type,
)
from fit_material.fitter.result.formatting import remarks
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.errors.printable import printable

BETWEEN = ", "


def materialx(materials: Sequence[FittedMaterial]) -> str:
    """The file's text: for each material a `surfacematerial` of its name, errors in its `doc`.

        mirror without a body    conductor_bsdf: ior n, extinction k
        body under a mirror      dielectric_bsdf (ior and tint of the reflectance) over the body
        body                     oren_nayar_diffuse_bsdf of `front_color`; its roughness 0 is Lambert's law

    Both roughnesses of a BSDF are alpha, the microfacet width. Colours are linear Rec. 709.

    Raises:
        ValueError: a number that a node needs is missing, not finite or out of range.
    """
    root = Element("materialx", version="1.39", colorspace="lin_rec709")
    names = identifiers(material.name for material in materials)
    for name, material in zip(names, materials, strict=True):
        graph = _Nodes(root, name)
        surface = graph.add("surface", "surfaceshader", bsdf=("BSDF", _bsdf(graph, material)))
        node = SubElement(
            root, "surfacematerial", name=name, type="material", doc=printable("; ".join(remarks(material)))
        )
        SubElement(node, "input", name="surfaceshader", type="surfaceshader", nodename=surface)
    ElementTree.indent(root)
    return ElementTree.tostring(root, "unicode", xml_declaration=True) + "\n"


class _Nodes:
    """Nodes of one material, each named after it and its own kind."""

    def __init__(self, root: Element, material: str) -> None:
        self._root, self._material = root, material

    def add(self, kind: str, output: str, **inputs: tuple[str, str]) -> str:
        """A node with inputs of a type and a value, which of type BSDF is another node's name; returns its name."""
        name = f"{self._material}__{kind}"
        node = SubElement(self._root, kind, name=name, type=output)
        for key, (what, value) in inputs.items():
            source = "nodename" if what == "BSDF" else "value"
            SubElement(node, "input", {"name": key, "type": what, source: value})
        return name


def _bsdf(graph: _Nodes, material: FittedMaterial) -> str:
    """The name of the node that scatters light as the material does."""
    kind = scattering_type(material)
    if not kind.has_body:
        return _conductor(graph, material)
    body = graph.add("oren_nayar_diffuse_bsdf", "BSDF", color=_color(front_color(material)))
    return _coated(graph, material, body) if kind.mirrors else body


def _conductor(graph: _Nodes, material: FittedMaterial) -> str:
    index = {"ior": _color(given(material, "n")), "extinction": _color(given(material, "k"))}
    return graph.add("conductor_bsdf", "BSDF", **index, roughness=_width(material))


def _coated(graph: _Nodes, material: FittedMaterial, body: str) -> str:
    """The dielectric surface over the node of that name."""
    ior, tint = index_and_tint(given(material, "reflectance"))
    index = {"ior": ("float", number(ior)), "tint": _color(tint)}
    coat = graph.add("dielectric_bsdf", "BSDF", **index, roughness=_width(material))
    return graph.add("layer", "BSDF", top=("BSDF", coat), base=("BSDF", body))


def _color(values: Sequence[float]) -> tuple[str, str]:
    return "color3", numbers(values, BETWEEN)


def _width(material: FittedMaterial) -> tuple[str, str]:
    return "vector2", numbers([given(material, "alpha")] * 2, BETWEEN)
