"""Where OpenGL draws: a context without a window."""

from __future__ import annotations

import functools

import moderngl

from fit_material.renderer.errors.input_error import InputError

VERSION = 430  # 4.3 core, MODEL.md 7
REMEDY = "sudo apt-get install libegl1 libgl1 libgl1-mesa-dri"
_TEXTURE_CUBE_MAP_SEAMLESS = 0x884F


@functools.cache
def offscreen_context() -> moderngl.Context:
    """An OpenGL 4.3 context through EGL, which needs no display; the same one at every call.

    Raises:
        InputError: a library is missing, or the driver is too old; names the remedy.
    """
    try:
        context = moderngl.create_context(VERSION, standalone=True, backend="egl")  # type: ignore[arg-type]
    except Exception as error:  # of whatever type the backend chose
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        expected = f"OpenGL 4.3 or newer through EGL ({reason}); on Debian or Ubuntu type: {REMEDY}"
        raise InputError("view", expected=expected) from None
    return prepared(context)


def prepared(context: moderngl.Context) -> moderngl.Context:
    """The context, on screen or off, with what drawing relies on: cubemaps that are filtered across their edges."""
    context.enable_direct(_TEXTURE_CUBE_MAP_SEAMLESS)
    return context
