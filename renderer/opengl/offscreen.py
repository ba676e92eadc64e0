"""Pictures without a window: the same drawing as on screen, read back."""

from __future__ import annotations

import moderngl
import numpy as np
from jaxtyping import Float

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.opengl.context import offscreen_context
from fit_material.renderer.opengl.drawing import Stage
from fit_material.renderer.opengl.targets import linear_target, release_target
from fit_material.renderer.viewer_model.model import Model
from fit_material.renderer.viewer_model.viewer_light import Surroundings


def render(
    model: Model,
    camera: Camera,
    surroundings: Surroundings,
    *,
    sky: bool = True,
    antialias: int = 4,
    neighbours: bool = True,
    context: moderngl.Context | None = None,
) -> Float[np.ndarray, "h w 4"]:
    """Draw one picture.

    Args:
        model, camera, surroundings: of the picture.
        sky: show the environment behind the objects; black where not.
        antialias: each pixel is the mean over this many times as many points, a regular grid; 1 is its centre.
        neighbours: let every reflective object of several mirror the others.
        context: to draw with; a new one where there is none.

    Returns:
        Linear radiance, Rec. 709, rows downwards; the fourth channel is the objects' coverage in [0, 1], by which
        radiance is premultiplied where there is no sky.

    Raises:
        InputError: there is no OpenGL, or the picture is too large for it.
    """
    context = context or offscreen_context()
    stage = Stage(context, model, surroundings, neighbours=neighbours, exact=True)
    try:
        return picture(context, stage, camera, sky=sky, antialias=antialias)
    finally:
        stage.release()


def picture(
    context: moderngl.Context,
    stage: Stage,
    camera: Camera,
    *,
    sky: bool = True,
    rotation: float = 0.0,
    antialias: int = 4,
) -> Float[np.ndarray, "h w 4"]:
    """As `render`, of a stage that is there already; for turntables and screenshots."""
    target = linear_target(context, (camera.width, camera.height))
    points = [(i + 0.5) / antialias - 0.5 for i in range(antialias)]
    total = np.zeros((camera.height, camera.width, 4))
    for offset in ((x, y) for y in points for x in points):
        stage.draw(target, camera, sky=sky, rotation=rotation, offset=offset)
        total += _read(target)
    release_target(target)
    return (total / antialias**2).astype(np.float32)


def _read(target: moderngl.Framebuffer) -> Float[np.ndarray, "h w 4"]:
    width, height = target.size
    return np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(height, width, 4)[::-1]
