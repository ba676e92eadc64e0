"""From stage and look to the pixels of a display: render, tone mapping, photographs beside and over it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from jaxtyping import Float, UInt8

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.opengl.drawing import Stage
from fit_material.renderer.opengl.programs import assign, programs
from fit_material.renderer.opengl.refinement import Refinement
from fit_material.renderer.viewer.compare import Area, Photograph, areas, exposure_factor
from fit_material.renderer.viewer.look import Look
from fit_material.shaders.tone_mapping import CURVES

_PICTURE, _PHOTOGRAPH, _SWIPE, _DIFFERENCE = range(4)  # of shaders/glsl/display.frag
_CONTENT = {"off": _PICTURE, "beside": _PICTURE, "swipe": _SWIPE, "difference": _DIFFERENCE}
_PICTURE_UNIT, _PHOTOGRAPH_UNIT = 0, 1
_AROUND = 0.12  # grey around pictures that do not fill the window

Codes = UInt8[np.ndarray, "h w 3"]


@dataclass(frozen=True)
class _Laid:
    """A photograph in the graphics memory."""

    photograph: Photograph
    texture: moderngl.Texture


class Display:
    """Shows a stage; keeps what it has drawn while only exposure, tone mapping or the swipe change.

    Args:
        context: to draw with.
        antialias: samples along each side of a pixel once the picture is finished.
    """

    def __init__(self, context: moderngl.Context, antialias: int = 4) -> None:
        self._context = context
        self._refinement = Refinement(context, antialias)
        self._screen = context.vertex_array(programs(context).get("screen.vert", "display.frag"), [])
        self._none = context.texture((1, 1), 4, bytes(16), dtype="f4")
        self._laid: _Laid | None = None

    @property
    def finished(self) -> bool:
        """Whether drawing the same once more would change nothing."""
        return self._refinement.finished

    def draw(
        self,
        framebuffer: moderngl.Framebuffer,
        size: tuple[int, int],
        stage: Stage,
        look: Look,
        photograph: Photograph | None = None,
        coarseness: int = 1,
    ) -> None:
        """Add a sample to the picture and show it.

        Args:
            framebuffer: of 8 bits; it gets sRGB codes.
            size: its width and height in pixels.
            stage, look: what, and how.
            photograph: for the look's comparison, whose camera is then the photograph's; without one there is none.
            coarseness: pixels of the framebuffer along each side of a pixel drawn.
        """
        comparison = "off" if photograph is None else look.comparison
        photograph = None if comparison == "off" else photograph
        camera = look.eye.camera(*size) if photograph is None else photograph.camera
        places = areas(comparison, *size, camera)
        sky = look.sky and not (photograph is not None and photograph.cut_out)
        drawn = -(-places[-1].width // coarseness), -(-places[-1].height // coarseness)
        self._refinement.add(stage, camera, drawn, sky, look.rotation)
        between = moderngl.NEAREST if coarseness == 1 else moderngl.LINEAR
        self._refinement.texture.filter = between, between
        framebuffer.use()
        framebuffer.viewport = (0, 0, *size)
        framebuffer.clear(_AROUND, _AROUND, _AROUND, 1.0)
        self._context.enable_only(moderngl.NOTHING)
        shared = self._uniforms(look, photograph)
        self._fill(framebuffer, places[-1], _CONTENT[comparison], shared)
        if comparison == "beside":
            self._fill(framebuffer, places[0], _PHOTOGRAPH, shared)

    def linear(self) -> Float[np.ndarray, "h w 4"]:
        """The render that was drawn last: linear radiance and coverage, rows downwards."""
        return self._refinement.mean()

    def forget(self) -> None:
        """The stage changed: draw it anew."""
        self._refinement.forget()

    def release(self) -> None:
        """Give the memory back."""
        self._refinement.release()
        self._screen.release()
        self._none.release()
        if self._laid is not None:
            self._laid.texture.release()

    def _uniforms(self, look: Look, photograph: Photograph | None) -> dict[str, Any]:
        self._refinement.texture.use(_PICTURE_UNIT)
        (self._none if photograph is None else self._lay(photograph)).use(_PHOTOGRAPH_UNIT)
        return {
            "picture": _PICTURE_UNIT,
            "photograph": _PHOTOGRAPH_UNIT,
            "samples": float(self._refinement.count),
            "photograph_factor": 1.0 if photograph is None else self._factor(photograph),
            "edge": look.edge,
            "exposure": look.exposure,
            "curve": CURVES.index(look.curve),
        }

    def _fill(self, framebuffer: moderngl.Framebuffer, area: Area, content: int, shared: dict[str, Any]) -> None:
        framebuffer.viewport = (area.x, area.y, area.width, area.height)
        corner, size = (float(area.x), float(area.y)), (float(area.width), float(area.height))
        assign(self._screen.program, {**shared, "content": content, "corner": corner, "size": size})
        self._screen.render(vertices=3)

    def _factor(self, photograph: Photograph) -> float:
        """By which the photograph's values become radiance."""
        if photograph.exposure_known:
            return 1.0
        rendered = self.linear()
        rows, columns = (
            ((np.arange(count) + 0.5) * of / count).astype(int)
            for count, of in zip(rendered.shape[:2], photograph.compared.shape, strict=True)
        )
        nearest = np.ix_(rows, columns)
        return exposure_factor(photograph.radiance[nearest], rendered[..., :3], photograph.compared[nearest])

    def _lay(self, photograph: Photograph) -> moderngl.Texture:
        if self._laid is None or self._laid.photograph is not photograph:
            if self._laid is not None:
                self._laid.texture.release()
            self._laid = _Laid(photograph, _texture(self._context, photograph))
        return self._laid.texture


def draw_whole(
    context: moderngl.Context,
    display: Display,
    size: tuple[int, int],
    stage: Stage,
    look: Look,
    photograph: Photograph | None = None,
) -> Codes:
    """The finished picture as the codes of a display, rows downwards; `Display.linear` has the radiance."""
    width, height = size
    codes = context.renderbuffer(size, 4)
    framebuffer = context.framebuffer([codes])
    try:
        display.draw(framebuffer, size, stage, look, photograph)
        while not display.finished:
            display.draw(framebuffer, size, stage, look, photograph)
        read = framebuffer.read(components=3, alignment=1)
    finally:
        framebuffer.release()
        codes.release()
    return np.frombuffer(read, np.uint8).reshape(height, width, 3)[::-1]


def _texture(context: moderngl.Context, photograph: Photograph) -> moderngl.Texture:
    """Radiance, and where it is compared; lowest row first, smoothed where it is shown smaller than it is."""
    pixels = np.concatenate([photograph.radiance, photograph.compared[..., None]], -1)[::-1]
    height, width = pixels.shape[:2]
    most = context.info["GL_MAX_TEXTURE_SIZE"]
    if max(width, height) > most:
        raise InputError(photograph.name, "size", f"{width} × {height}", f"at most {most} pixels along a side")
    texture = context.texture((width, height), 4, pixels.astype(np.float32).tobytes(), dtype="f4")
    texture.repeat_x = texture.repeat_y = False
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    return texture
