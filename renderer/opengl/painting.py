"""One pass over a framebuffer: the sky, the depth of all surfaces, then each surface's light, once per pixel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import moderngl

from fit_material.renderer.opengl.effects import Definitions, definitions
from fit_material.renderer.opengl.geometry import Geometry, Group
from fit_material.renderer.opengl.programs import UNITS, assign, programs
from fit_material.renderer.opengl.uploads import (
    cubemap_texture,
    light_uniforms,
    map_textures,
    material_uniforms,
    turn_uniforms,
)
from fit_material.renderer.opengl.view import View
from fit_material.renderer.viewer_model.model import Model
from fit_material.renderer.viewer_model.viewer_light import Surroundings

_ENVIRONMENT, _NEIGHBOURS = UNITS["environment"], UNITS["neighbours"]


@dataclass(frozen=True)
class Pass:
    """What one picture shows, and how.

    Attributes:
        view: from where.
        rotation: degrees by which the environment is rotated about +Y.
        sky: show the environment behind the surfaces.
        without: an object that is left out; None for none.
        near: where alpha shall hold depth 1 - near/D, that radius [MODEL.md 3.3]; None for coverage.
        neighbours: captured cubemaps by object.
    """

    view: View
    rotation: float
    sky: bool = True
    without: int | None = None
    near: float | None = None
    neighbours: Mapping[int, moderngl.TextureCube] = field(default_factory=dict)


class Painter:
    """A model and its surroundings in the graphics memory, ready for passes; the arguments are those of a `Stage`."""

    def __init__(
        self, context: moderngl.Context, model: Model, surroundings: Surroundings, *, exact: bool = False
    ) -> None:
        self._exact = exact
        self._context, self._programs = context, programs(context)
        self._appearances = model.appearances
        self.geometry = Geometry(context, model.mesh)
        self._lights = len(surroundings.sources)
        self._light_uniforms = light_uniforms(surroundings)
        self._environment = cubemap_texture(context, surroundings.cubemap.faces)
        self._maps = [map_textures(context, appearance.maps) for appearance in model.appearances]
        self._sky = context.vertex_array(self._programs.get("screen.vert", "sky.frag"), [])
        self._drawn: dict[tuple[Group, moderngl.Program], moderngl.VertexArray] = {}

    def paint(self, framebuffer: moderngl.Framebuffer, wanted: Pass) -> None:
        """Fill a float RGBA framebuffer that has a depth attachment."""
        groups = [group for group in self.geometry.groups if group.part != wanted.without]
        framebuffer.use()
        framebuffer.clear()
        self._context.enable_only(moderngl.NOTHING)  # neither culls nor blends
        self._environment.use(_ENVIRONMENT)
        if wanted.sky:
            self._paint_sky(wanted)
        self._context.enable_only(moderngl.DEPTH_TEST)
        if (
            wanted.near is not None
        ):  # a capture looks through inner sides, as renderer/viewer_model/captured_neighbours.py does
            self._context.enable(moderngl.CULL_FACE)
        self._paint_depth(framebuffer, groups, wanted)
        self._context.depth_func = "<="
        for group in groups:
            self._paint_surface(group, wanted)

    def release(self) -> None:
        """Give the memory back; the compiled programs stay with the context."""
        for array in (self._sky, *self._drawn.values()):
            array.release()
        for texture in (self._environment, *(texture for maps in self._maps for texture in maps.values())):
            texture.release()
        self.geometry.release()

    def _paint_sky(self, wanted: Pass) -> None:
        assign(self._sky.program, {**self._uniforms(wanted), "alpha": 0.0 if wanted.near is None else 1.0})
        self._sky.render(vertices=3)

    def _paint_depth(self, framebuffer: moderngl.Framebuffer, groups: Sequence[Group], wanted: Pass) -> None:
        """Depth alone, so that no light is computed for hidden surfaces."""
        framebuffer.color_mask = False, False, False, False
        program = self._programs.get("surface.vert", "depth.frag")
        assign(program, self._uniforms(wanted))
        for group in groups:
            self._vertex_array(group, program).render()
        framebuffer.color_mask = True, True, True, True

    def _paint_surface(self, group: Group, wanted: Pass) -> None:
        appearance = self._appearances[group.material]
        captured = wanted.neighbours.get(group.part)
        if captured is not None:
            captured.use(_NEIGHBOURS)
        program = self._programs.get("surface.vert", "surface.frag", self._definitions(group, wanted))
        assign(program, {**self._uniforms(wanted), **self._light_uniforms, **material_uniforms(appearance)})
        for name, texture in self._maps[group.material].items():
            texture.use(UNITS[name])
        if self._exact:
            self.geometry.bind_exact(group)
        self._vertex_array(group, program).render()

    def _definitions(self, group: Group, wanted: Pass) -> Definitions:
        return definitions(
            self._appearances[group.material],
            lights=self._lights,
            uv=self.geometry.has_uv,
            tangents=self.geometry.has_tangents,
            neighbours=group.part in wanted.neighbours,
            depth=wanted.near is not None,
            exact=self._exact,
        )

    def _uniforms(self, wanted: Pass) -> dict:
        view = wanted.view.told_from(self.geometry.bounds.centre)
        return {
            "to_clip": view.to_clip.T,
            "film_direction": view.film_direction.T,
            "film_origin": view.film_origin.T,
            "eye": view.eye,
            "near": wanted.near or 0.0,
            **turn_uniforms(wanted.rotation),
        }

    def _vertex_array(self, group: Group, program: moderngl.Program) -> moderngl.VertexArray:
        if (group, program) not in self._drawn:
            self._drawn[group, program] = self.geometry.vertex_array(group, program)
        return self._drawn[group, program]
