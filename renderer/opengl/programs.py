"""Shader programs: GLSL files put together with their definitions, compiled once for each set of them."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any

import moderngl
import numpy as np

from fit_material.renderer.opengl.effects import Definitions

UNITS: Mapping[str, int] = {
    "environment": 0,
    "neighbours": 1,
    "color_map": 2,
    "normal_map": 3,
    "ambient_occlusion_map": 4,
}
"""The texture unit of each sampler."""

_VERSION = "#version 430 core\n"
_PLAIN: Definitions = frozenset()


class Programs:
    """The programs of one context.

    Args:
        context: with which they are compiled.
    """

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._compiled: dict[tuple[str, str, Definitions], moderngl.Program] = {}
        for file in resources.files("fit_material.shaders.glsl").iterdir():
            if file.name.endswith(".glsl"):
                context.includes[file.name] = file.read_text("utf-8")

    def get(self, vertex: str, fragment: str, definitions: Definitions = _PLAIN) -> moderngl.Program:
        """The program of two files in shaders/glsl under the given definitions."""
        key = (vertex, fragment, definitions)
        if key not in self._compiled:
            program = self._context.program(
                vertex_shader=_source(vertex, definitions), fragment_shader=_source(fragment, definitions)
            )
            assign(program, UNITS)
            self._compiled[key] = program
        return self._compiled[key]


def programs(context: moderngl.Context) -> Programs:
    """The programs of a context: the same ones at every call."""
    if not isinstance(context.extra, Programs):
        context.extra = Programs(context)
    return context.extra


def assign(program: moderngl.Program, values: Mapping[str, Any]) -> None:
    """Set the uniforms that the program has; a matrix is given transposed, since OpenGL holds it by columns."""
    for name, value in values.items():
        if name in program:
            uniform: Any = program[name]
            uniform.write(np.asarray(value).astype(uniform.fmt[-1]).tobytes())  # "9d" is nine doubles


def _source(name: str, definitions: Definitions) -> str:
    text = (resources.files("fit_material.shaders.glsl") / name).read_text("utf-8")
    lines = "".join(f"#define {key} {value}\n" for key, value in sorted(definitions))
    return text.replace(_VERSION, _VERSION + lines, 1)
