"""Framebuffers for linear radiance."""

from __future__ import annotations

import moderngl

from fit_material.renderer.errors.input_error import InputError


def linear_target(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Framebuffer:
    """A framebuffer of float32 RGBA with depth, `size` = width, height in pixels.

    Its colour is a texture, `color_attachments[0]`, for further passes to read.

    Raises:
        InputError: larger than the graphics card can draw.
    """
    require_fitting(context, "picture", size)
    color = context.texture(size, 4, dtype="f4")
    color.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return context.framebuffer([color], context.depth_renderbuffer(size))


def require_fitting(context: moderngl.Context, what: str, size: tuple[int, int]) -> None:
    """Whether the graphics card has room for a texture of that width and height.

    Raises:
        InputError: it has not; `what` names whose size it is.
    """
    width, height = size
    most = context.info["GL_MAX_TEXTURE_SIZE"]
    if max(size) > most:
        raise InputError("view", f"size of a {what}", f"{width} × {height}", f"at most {most} pixels along each side")


def release_target(framebuffer: moderngl.Framebuffer) -> None:
    """Give the memory of a framebuffer and its attachments back."""
    depth = framebuffer.depth_attachment
    for attachment in (*framebuffer.color_attachments, *([depth] if depth else [])):
        attachment.release()
    framebuffer.release()
