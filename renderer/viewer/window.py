"""The window: glfw's events go to the session, which draws into it. Glue, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import glfw
import moderngl

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.opengl.context import VERSION, prepared
from fit_material.renderer.viewer.session import Session, Subject
from fit_material.renderer.viewer.watch import INTERVAL

SIZE = (1280, 800)
_REMEDY = "without one use --screenshot FILE"

_KEYS = {
    glfw.KEY_TAB: "tab",
    glfw.KEY_ESCAPE: "escape",
    glfw.KEY_F1: "f1",
    glfw.KEY_F2: "f2",
    glfw.KEY_F3: "f3",
    glfw.KEY_F4: "f4",
}
_WALK_KEYS = {  # by their place: W S A D lie together on every keyboard, whatever letters are on them
    glfw.KEY_W: "w",
    glfw.KEY_S: "s",
    glfw.KEY_A: "a",
    glfw.KEY_D: "d",
    glfw.KEY_SPACE: "space",
    glfw.KEY_LEFT_CONTROL: "control",
    glfw.KEY_RIGHT_CONTROL: "control",
}
_REPEATED = "+-=[]"  # while they are held; the others act once
_BUTTONS = {
    glfw.MOUSE_BUTTON_LEFT: "left",
    glfw.MOUSE_BUTTON_MIDDLE: "middle",
    glfw.MOUSE_BUTTON_RIGHT: "right",
}


def run(subject: Subject, size: tuple[int, int] = SIZE) -> None:
    """Show a model until the user closes the window.

    Args:
        subject: of the pictures.
        size: of the window, in the units of the desktop.

    Raises:
        InputError: the model cannot be read, there is no display, or its OpenGL is too old.
    """
    model = subject.read()
    with _window(size, model.files[0].name) as window:
        session = Session(prepared(moderngl.create_context(require=VERSION)), subject, model)
        try:
            _Events(window, session).loop()
        finally:
            session.release()


class _Events:
    """What happens to one window."""

    def __init__(self, window: Any, session: Session) -> None:
        self._window, self._session = window, session
        self._screen = moderngl.get_context().screen
        self._held: set[str] = set()
        self._repeating = False
        self._button, self._shift, self._mouse = "", False, glfw.get_cursor_pos(window)
        self._title = ""
        glfw.set_key_callback(window, self._on_key)
        glfw.set_char_callback(window, self._on_char)
        glfw.set_mouse_button_callback(window, self._on_button)
        glfw.set_cursor_pos_callback(window, self._on_cursor)
        glfw.set_scroll_callback(window, lambda _window, _right, notches: session.scroll(notches))
        glfw.set_window_focus_callback(window, lambda _window, _focused: self._held.clear())
        glfw.set_framebuffer_size_callback(window, lambda _window, _width, _height: self._resized())
        glfw.set_window_refresh_callback(window, lambda _window: self._draw())
        self._resized()

    def loop(self) -> None:
        """Until the window is closed: wait for something to happen, and draw when it did."""
        last = looked = time.perf_counter()
        while not (glfw.window_should_close(self._window) or self._session.wants_to_quit):
            walking = self._session.controls.walks(self._held)
            if self._visible and (walking or self._session.busy):
                glfw.poll_events()
            else:
                glfw.wait_events_timeout(INTERVAL)
            now = time.perf_counter()
            self._session.walk(self._held, now - last)
            last = now
            if now - looked >= INTERVAL:
                looked = now
                self._session.look_for_changes()
            self._session.film()
            if self._visible and self._session.busy:
                self._draw()
            self._show_title()

    @property
    def _visible(self) -> bool:
        """Not minimised, when a window has no pixels."""
        return 0 not in self._session.size

    def _draw(self) -> None:
        self._session.draw(self._screen)
        glfw.swap_buffers(self._window)

    def _resized(self) -> None:
        self._session.size = glfw.get_framebuffer_size(self._window)  # pixels, which dense displays have more of
        self._session.refresh()

    def _show_title(self) -> None:
        title = f"{self._session.name} — {self._session.title}"
        if title != self._title:
            self._title = title
            glfw.set_window_title(self._window, title)

    def _on_key(self, _window: Any, key: int, _scancode: int, action: int, modifiers: int) -> None:
        self._repeating = action == glfw.REPEAT
        if key in _WALK_KEYS:
            (self._held.discard if action == glfw.RELEASE else self._held.add)(_WALK_KEYS[key])
        if key in _KEYS and action == glfw.PRESS:
            self._session.press(_KEYS[key], bool(modifiers & glfw.MOD_SHIFT))

    def _on_char(self, _window: Any, code: int) -> None:
        """What a key types on the user's keyboard; follows its `_on_key`."""
        typed = chr(code).lower()
        if typed in _REPEATED or not self._repeating:
            self._session.press(typed)

    def _on_button(self, _window: Any, button: int, action: int, modifiers: int) -> None:
        self._button = _BUTTONS.get(button, "") if action == glfw.PRESS else ""
        self._shift = bool(modifiers & glfw.MOD_SHIFT)

    def _on_cursor(self, _window: Any, x: float, y: float) -> None:
        if self._button:
            height = max(1, glfw.get_window_size(self._window)[1])  # in the cursor's units
            right, down = (x - self._mouse[0]) / height, (y - self._mouse[1]) / height
            self._session.drag(self._button, right, down, self._shift)
        self._mouse = x, y


@contextmanager
def _window(size: tuple[int, int], title: str) -> Iterator[Any]:
    """A window whose OpenGL context is current."""
    glfw.ERROR_REPORTING = "ignore"  # its errors are fetched, and reported in one sentence
    if not glfw.init():
        raise InputError("view", expected=f"a display ({_reason()}); {_REMEDY}")
    try:
        window = _created(size, title)
        glfw.make_context_current(window)
        glfw.swap_interval(1)
        yield window
    finally:
        glfw.terminate()


def _created(size: tuple[int, int], title: str) -> Any:
    hints = {
        glfw.CONTEXT_VERSION_MAJOR: VERSION // 100,
        glfw.CONTEXT_VERSION_MINOR: VERSION % 100 // 10,
        glfw.OPENGL_PROFILE: glfw.OPENGL_CORE_PROFILE,
        glfw.OPENGL_FORWARD_COMPAT: True,
        glfw.SCALE_TO_MONITOR: True,
        glfw.DEPTH_BITS: 0,
    }
    for hint, value in hints.items():
        glfw.window_hint(hint, value)
    window = glfw.create_window(*size, title, None, None)
    if not window:
        raise InputError("view", expected=f"a display with OpenGL 4.3 or newer ({_reason()}); {_REMEDY}")
    return window


def _reason() -> str:
    """glfw's own words about its last error."""
    description: Any = glfw.get_error()[1]
    return (description or b"no reason given").decode(errors="replace").removeprefix("X11: ").rstrip(".")
