"""What keys and mouse do: a state machine that knows neither window nor GL.

The window passes events on (`press`, `drag`, `scroll`, `pass_time`), draws its `look`, shows its `message`, and
does what it cannot do itself: the `Command` that `press` returns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, MutableMapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from enum import Enum, auto
from types import MappingProxyType
from typing import TypeVar

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.opengl.geometry import Bounds
from fit_material.renderer.viewer import eye
from fit_material.renderer.viewer.eye import Eye
from fit_material.renderer.viewer.look import COMPARISONS, Comparison, Look
from fit_material.shaders.tone_mapping import CURVES

T = TypeVar("T")

BOOKMARK_KEYS = ("f1", "f2", "f3", "f4")

SPEED = 1.0  # radii of the model per second
LONGEST_STEP = 0.1  # seconds; a window that hung does not throw its user across the scene
ZOOM_STEP = 1.12  # per notch of the wheel
ZOOM_DRAG = 3.0  # e-folds per height of the window
TURN_DRAG = math.pi  # radians per height of the window
ROTATION_STEP, EXPOSURE_STEP = 5.0, 0.25  # degrees, stops
EXPOSURE_LIMIT = 30.0  # stops; 2^±30 leaves any picture black or white


class Command(Enum):
    """What the window has to do after a key."""

    QUIT = auto()
    PICTURE = auto()
    TURNTABLE = auto()
    RELOAD = auto()
    HELP = auto()


class Controls:
    """The state machine.

    Args:
        look: to begin with.
        bounds: of the model.
        bookmarks: kept eyes by "f1" … "f4"; storing one may write a file.
        photographs: their cameras; without any, the keys of the comparison report it.

    Attributes:
        look: as it is now.
        message: about the last key, one line; empty where there is none.
    """

    def __init__(
        self,
        look: Look,
        bounds: Bounds,
        bookmarks: MutableMapping[str, Eye] | None = None,
        photographs: Sequence[Camera] = (),
    ) -> None:
        self.look, self.bounds = look, bounds
        self.bookmarks: MutableMapping[str, Eye] = {} if bookmarks is None else bookmarks
        self.photographs = photographs
        self.message = ""
        if look.comparison != "off":
            self._compare(look.comparison, look.photograph)

    def press(self, key: str, shift: bool = False, aspect: float = 1.0) -> Command | None:
        """A key went down, or repeats.

        Args:
            key: "tab", "escape", "f1" …, or what the key types, in lower case.
            shift: whether Shift is held.
            aspect: the window's width over its height.
        """
        self.message = ""
        if key in BOOKMARK_KEYS:
            self._keep(key) if shift else self._recall(key)
        elif key == "f":
            self._move(eye.frame(self.look.eye, self.bounds, aspect))
        elif key.isdecimal() and key.isascii() and key != "0":
            self._compare(self._comparison_in_use(), int(key) - 1)
        elif key in _ACTIONS:
            _ACTIONS[key](self)
        return _COMMANDS.get(key)

    def drag(self, button: str, right: float, down: float, shift: bool = False, aspect: float = 1.0) -> None:
        """The mouse moved with a button held.

        Args:
            button: "left", "middle" or "right".
            right, down: in heights of the window.
            shift: whether Shift was held when the button went down.
            aspect: the window's width over its height.
        """
        if button == "left" and shift:
            self._turn_surroundings(math.degrees(TURN_DRAG) * right)
        elif button == "left" and self.look.comparison == "swipe":
            self.look = replace(self.look, edge=min(1.0, max(0.0, self.look.edge + right / aspect)))
        elif button == "left":
            turn, angle = (eye.look_round, self._angle_seen(aspect)) if self.look.walking else (eye.orbit, TURN_DRAG)
            self._move(turn(self.look.eye, -angle * right, -angle * down))
        elif button == "right":
            self._move(eye.zoom(self.look.eye, math.exp(ZOOM_DRAG * down), self.bounds))
        elif button == "middle":
            self._move(eye.pan(self.look.eye, -2 * right / aspect, 2 * down / aspect))

    def scroll(self, notches: float) -> None:
        """The wheel turned, away from the user where positive: closer, or a step forward."""
        if self.look.walking:
            self._move(eye.walk(self.look.eye, 0.0, 0.0, 0.1 * SPEED * self.bounds.radius * notches))
        else:
            self._move(eye.zoom(self.look.eye, ZOOM_STEP**-notches, self.bounds))

    def pass_time(self, held: AbstractSet[str], seconds: float) -> None:
        """Walk on, `seconds` after the last call, with these keys held: "w" "s" "a" "d" "space" "control"."""
        right, up, forward = (
            float(("d" in held) - ("a" in held)),
            float(("space" in held) - ("control" in held)),
            float(("w" in held) - ("s" in held)),
        )
        length = math.hypot(right, up, forward)
        if self.look.walking and length > 0:
            step = SPEED * self.bounds.radius * min(seconds, LONGEST_STEP) / length
            self._move(eye.walk(self.look.eye, step * right, step * up, step * forward))

    def walks(self, held: AbstractSet[str]) -> bool:
        """Whether these held keys keep the picture moving."""
        return self.look.walking and bool(held & {"w", "s", "a", "d", "space", "control"})

    def _move(self, moved: Eye) -> None:
        """A camera of one's own is not the photograph's: the comparison ends."""
        if self.look.comparison != "off":
            self.message = "left the photograph's camera; C or N goes back to it"
        self.look = replace(self.look, eye=moved, comparison="off")

    def _keep(self, key: str) -> None:
        self.message = f"{key.upper()} keeps this camera"
        self.bookmarks[key] = self.look.eye

    def _recall(self, key: str) -> None:
        kept = self.bookmarks.get(key)
        if kept is None:
            self.message = f"{key.upper()} keeps no camera; Shift+{key.upper()} makes it keep this one"
        else:
            self._move(kept)
            self.message = f"camera {key.upper()}"

    def _switch_walking(self) -> None:
        self.look = replace(self.look, walking=not self.look.walking)
        self.message = "walking: W S A D, Space, Ctrl" if self.look.walking else "turning round the model"

    def _turn_surroundings(self, degrees: float) -> None:
        self.look = replace(self.look, rotation=math.remainder(self.look.rotation + degrees, 360))
        self.message = f"surroundings rotated by {self.look.rotation:.0f}°"

    def _expose(self, stops: float) -> None:
        exposure = min(EXPOSURE_LIMIT, max(-EXPOSURE_LIMIT, self.look.exposure + stops))
        self.look = replace(self.look, exposure=exposure)
        self.message = f"exposure {exposure:+.2f} stops"

    def _next_curve(self) -> None:
        curve = _next(CURVES, self.look.curve)
        self.look = replace(self.look, curve=curve)
        self.message = f"tone mapping: {curve}"

    def _switch_sky(self) -> None:
        self.look = replace(self.look, sky=not self.look.sky)

    def _next_comparison(self) -> None:
        self._compare(_next(COMPARISONS, self.look.comparison), self.look.photograph)

    def _next_photograph(self) -> None:
        shown = self.look.comparison != "off"  # the first time, the first photograph
        self._compare(self._comparison_in_use(), (self.look.photograph + shown) % max(1, len(self.photographs)))

    def _comparison_in_use(self) -> Comparison:
        return "beside" if self.look.comparison == "off" else self.look.comparison

    def _compare(self, comparison: Comparison, photograph: int) -> None:
        """Look through the camera of a photograph, and at it."""
        if not 0 <= photograph < len(self.photographs):
            count = len(self.photographs)
            self.message = f"there are {count} photographs" if count else "no photographs; give them by --photograph"
            self.look = replace(self.look, comparison="off")
            return
        if comparison == "off":
            self.look = replace(self.look, comparison="off")
            return
        through = eye.eye_of(self.photographs[photograph], self.bounds.centre)
        self.look = replace(self.look, eye=through, comparison=comparison, photograph=photograph)
        self.message = f"photograph {photograph + 1} of {len(self.photographs)}: {comparison}"

    def _angle_seen(self, aspect: float) -> float:
        """Radians per height of the window, so that the scene keeps up with the mouse."""
        return math.radians(self.look.eye.fov) / aspect


def _next(choices: Sequence[T], current: T) -> T:
    return choices[(choices.index(current) + 1) % len(choices)]


_COMMANDS = MappingProxyType(
    {
        "escape": Command.QUIT,
        "p": Command.PICTURE,
        "m": Command.TURNTABLE,
        "r": Command.RELOAD,
        "h": Command.HELP,
        "?": Command.HELP,
    }
)

_ACTIONS: dict[str, Callable[[Controls], None]] = {
    "tab": Controls._switch_walking,
    "[": lambda controls: controls._turn_surroundings(-ROTATION_STEP),
    "]": lambda controls: controls._turn_surroundings(ROTATION_STEP),
    "+": lambda controls: controls._expose(EXPOSURE_STEP),
    "=": lambda controls: controls._expose(EXPOSURE_STEP),  # the same key without Shift
    "-": lambda controls: controls._expose(-EXPOSURE_STEP),
    "0": lambda controls: controls._expose(-controls.look.exposure),
    "t": Controls._next_curve,
    "b": Controls._switch_sky,
    "c": Controls._next_comparison,
    "n": Controls._next_photograph,
}
