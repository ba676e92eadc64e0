"""Framebuffers for linear radiance."""

from __future__ import annotations

import moderngl


def linear_target(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Framebuffer:
    """A framebuffer of float32 RGBA with depth, `size` = width, height in pixels.

    Its colour is a texture, `color_attachments[0]`, for further passes to read.
    """
    color = context.texture(size, 4, dtype="f4")
    color.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return context.framebuffer([color], context.depth_renderbuffer(size))


def release_target(framebuffer: moderngl.Framebuffer) -> None:
    """Give the memory of a framebuffer and its attachments back."""
    depth = framebuffer.depth_attachment
    for attachment in (*framebuffer.color_attachments, *([depth] if depth else [])):
        attachment.release()
    framebuffer.release()
