"""A picture that grows smoother while nothing moves: one sample per pixel at a time, summed up."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from jaxtyping import Float

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.opengl.drawing import Stage
from fit_material.renderer.opengl.programs import assign, programs
from fit_material.renderer.opengl.targets import linear_target, release_target


class Refinement:
    """The sum of a picture's samples so far.

    Args:
        context: to draw with.
        antialias: samples along each side of a pixel once the picture is finished.

    Attributes:
        count: samples in the sum.
    """

    def __init__(self, context: moderngl.Context, antialias: int) -> None:
        self._context, self._offsets = context, sample_offsets(antialias)
        self._copy = context.vertex_array(programs(context).get("screen.vert", "copy.frag"), [])
        self._sample: moderngl.Framebuffer | None = None
        self._sum: moderngl.Framebuffer | None = None
        self._shown: Any = None
        self.count = 0

    @property
    def finished(self) -> bool:
        """Whether further samples would change nothing."""
        return self.count == len(self._offsets)

    def add(self, stage: Stage, camera: Camera, size: tuple[int, int], sky: bool, rotation: float) -> bool:
        """Draw the next sample; the first one, if this is not the picture of the last call.

        Returns:
            Whether the picture changed.
        """
        sample = self._begun((stage, camera_key(camera), size, sky, rotation), size)
        if self.finished:
            return False
        stage.draw(sample, camera, sky=sky, rotation=rotation, offset=self._offsets[self.count])
        self._add(sample)
        self.count += 1
        return True

    def forget(self) -> None:
        """Begin anew with the next sample."""
        self._shown = None

    @property
    def texture(self) -> moderngl.Texture:
        """The sum; after the first `add`."""
        assert self._sum is not None
        return self._sum.color_attachments[0]  # type: ignore[return-value] — a texture, see linear_target

    def mean(self) -> Float[np.ndarray, "h w 4"]:
        """Linear radiance and coverage, rows downwards."""
        width, height = self.texture.size
        total = np.frombuffer(self.texture.read(), np.float32).reshape(height, width, 4)[::-1]
        return total / np.float32(self.count)

    def release(self) -> None:
        """Give the memory back."""
        self._release_targets()
        self._copy.release()

    def _begun(self, shown: Any, size: tuple[int, int]) -> moderngl.Framebuffer:
        if self._sample is None or self._sum is None or self._sample.size != size:
            self._release_targets()
            self._sample, self._sum = linear_target(self._context, size), linear_target(self._context, size)
        if shown != self._shown:
            self._shown, self.count = shown, 0
            self._sum.clear()
        return self._sample

    def _add(self, sample: moderngl.Framebuffer) -> None:
        assert self._sum is not None
        self._sum.use()
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE
        sample.color_attachments[0].use(0)  # type: ignore[union-attr] — a texture, see linear_target
        assign(self._copy.program, {"picture": 0})
        self._copy.render(vertices=3)

    def _release_targets(self) -> None:
        for target in (self._sample, self._sum):
            if target is not None:
                release_target(target)
        self._sample = self._sum = None


def sample_offsets(antialias: int) -> list[tuple[float, float]]:
    """The points of a regular grid inside a pixel, relative to its centre, so ordered that few are spread already.

    Steps by the golden ratio through the rows, and from row to row: the second of two is always far from the first.
    """
    points = [(i + 0.5) / antialias - 0.5 for i in range(antialias)]
    count = antialias**2
    order = sorted(range(count), key=lambda i: (i * 0.6180339887498949) % 1)
    return [(points[i % antialias], points[i // antialias]) for i in order]


def camera_key(camera: Camera) -> tuple:
    """The key of a camera's picture."""
    return (
        camera.camera_to_world.numpy().tobytes(),
        camera.width,
        camera.height,
        camera.projection,
        camera.fov,
        camera.scale,
    )
