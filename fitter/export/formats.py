"""The formats of other programs that a result is exported in."""

from __future__ import annotations

from collections.abc import Callable
from pkgutil import resolve_name
from typing import Any

from fit_material.fitter.export.format import Format, text_file
from fit_material.shaders.registry.registry import Registry


def _late(function: str) -> Callable[[Any], Any]:
    """A function of this folder, "module:name", imported by its first call: help lists formats, and loads no torch."""
    return lambda argument: resolve_name(f"{__package__}.{function}")(argument)


FORMATS: Registry[Format] = Registry(
    Format("thesis", ".thesis.mtl", _late("mtl:thesis_files")),
    Format("mtl", ".mtl", _late("mtl:ordinary_files")),
    Format("gltf", ".gltf", text_file(_late("gltf:gltf"))),
    Format("materialx", ".mtlx", text_file(_late("materialx:materialx"))),
    Format("mitsuba", ".xml", text_file(_late("mitsuba_xml:mitsuba_xml"))),
    Format("blender", ".blender.py", text_file(_late("blender:blender"))),
)
"""All formats, in the order of the command line's help."""
