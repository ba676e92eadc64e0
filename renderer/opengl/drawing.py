"""Drawing a model in its surroundings: uploaded once, drawn as often as wanted, in linear radiance."""

from __future__ import annotations

import moderngl

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.opengl.capture import Captures, capturing_objects
from fit_material.renderer.opengl.painting import Painter, Pass
from fit_material.renderer.opengl.view import camera_view
from fit_material.renderer.viewer_model.model import Model
from fit_material.renderer.viewer_model.viewer_light import Surroundings


class Stage:
    """A model and its surroundings in the graphics memory.

    Args:
        context: OpenGL 4.3 or newer, from `context.offscreen_context` or through `context.prepared`.
        model: what to draw.
        surroundings: the light.
        neighbours: let every reflective object of several mirror the others [MODEL.md 2, 3.3].
        exact: find where rays meet triangles in double precision, which a display has no use for, and which many
            graphics cards are slow at; without it mirrors are wrong by up to some 1e-4 at grazing angles.

    Attributes:
        bounds: the model's bounding box, its centre and half its diagonal.
    """

    def __init__(
        self,
        context: moderngl.Context,
        model: Model,
        surroundings: Surroundings,
        *,
        neighbours: bool = True,
        exact: bool = False,
    ) -> None:
        self._painter = Painter(context, model, surroundings, exact=exact)
        self._captures = Captures(context, self._painter, capturing_objects(model) if neighbours else {})
        self.bounds = self._painter.geometry.bounds

    def draw(
        self,
        framebuffer: moderngl.Framebuffer,
        camera: Camera,
        *,
        sky: bool = True,
        rotation: float = 0.0,
        offset: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Draw linear radiance, Rec. 709; alpha is the objects' coverage, 0 or 1.

        Args:
            framebuffer: float RGBA with depth, see `targets.linear_target`; filled as a whole, lowest row first.
            camera: whose film is spread over the framebuffer; their aspects should agree.
            sky: show the environment behind the objects; black where not.
            rotation: degrees by which the environment is rotated about +Y, beyond its own turn; lights stay.
            offset: by which every pixel is sampled off its centre, rightwards and upwards, in pixels.
        """
        captured = self._captures.at(rotation)
        view = camera_view(camera, framebuffer.size, self.bounds, offset)
        self._painter.paint(framebuffer, Pass(view, rotation, sky, neighbours=captured))

    def release(self) -> None:
        """Give the memory back; the compiled programs stay with the context."""
        self._captures.release()
        self._painter.release()
