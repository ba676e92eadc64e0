"""Keys and mouse, without a window."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.opengl.geometry import Bounds
from fit_material.renderer.viewer.controls import _ACTIONS, _COMMANDS, BOOKMARK_KEYS, Command, Controls
from fit_material.renderer.viewer.eye import Eye
from fit_material.renderer.viewer.help import help_text
from fit_material.renderer.viewer.look import Look

BOUNDS = Bounds(np.zeros(3), 2.0)
START = Look(Eye((0.0, 0.0, 0.0), 8.0, yaw=0.4, pitch=-0.3))
PHOTOGRAPHS = [Eye((0.0, 0.0, 0.0), 5.0, yaw, 0.1, fov=30.0).camera(8, 6) for yaw in (0.0, 2.0, 4.0)]

KEYS = sorted({*_ACTIONS, *_COMMANDS, *BOOKMARK_KEYS, "f", "1", "3", "9", "x", "²"})
WALK_KEYS = ["w", "s", "a", "d", "space", "control"]

shares = st.floats(-3, 3)
events = st.one_of(
    st.tuples(st.just("press"), st.sampled_from(KEYS), st.booleans(), st.floats(0.2, 5)),
    st.tuples(
        st.just("drag"), st.sampled_from(["left", "middle", "right"]), shares, shares, st.booleans(), st.floats(0.2, 5)
    ),
    st.tuples(st.just("scroll"), st.floats(-100, 100)),
    st.tuples(st.just("pass_time"), st.sets(st.sampled_from(WALK_KEYS)), st.floats(0, 1e3)),
)


def controls(look: Look = START, photographs=PHOTOGRAPHS) -> Controls:
    return Controls(look, BOUNDS, {}, photographs)


@given(st.lists(events, max_size=30))
def test_nothing_that_a_user_does_breaks_the_view(happened):
    state = controls()
    for name, *arguments in happened:
        getattr(state, name)(*arguments)
        look = state.look
        matrix = look.eye.camera(4, 3).camera_to_world.numpy()
        assert np.isfinite(matrix).all()
        # errors grow by a rounding with every turn of the position, never of the rotation, which is made anew
        np.testing.assert_allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-14)
        assert look.eye.distance > 0
        assert abs(look.rotation) <= 180
        assert abs(look.exposure) <= 30
        assert 0 <= look.edge <= 1
        assert 0 <= look.photograph < len(PHOTOGRAPHS)


def test_every_key_does_something_and_is_told():
    """In the help, each stands by its own name."""
    named = {"tab": "Tab", "escape": "Esc", "-": "−", "=": "+", "f2": "F1–F4", "f3": "F1–F4"}
    told = help_text()
    for key in {*_ACTIONS, *_COMMANDS, *BOOKMARK_KEYS, "f", "1"}:
        name = named.get(key, key.upper())
        assert name in told
        state = controls(replace(START, exposure=1.0))
        before = state.look
        command = state.press(key)
        assert command or state.look != before or state.message, key


@pytest.mark.parametrize(
    ("key", "command"),
    [
        ("escape", Command.QUIT),
        ("p", Command.PICTURE),
        ("m", Command.TURNTABLE),
        ("r", Command.RELOAD),
        ("?", Command.HELP),
        ("x", None),
    ],
)
def test_commands(key, command):
    state = controls()
    assert state.press(key) is command
    assert state.look == START


def test_dragging_moves_the_model_with_the_mouse():
    """A point on the model's near side goes the way that the mouse goes."""
    near = START.eye.rotation[:, 2] * BOUNDS.radius

    def seen(eye: Eye) -> np.ndarray:
        x, y, z = eye.rotation.T @ (near - eye.origin)
        return np.array([x, y]) / -z

    for button in ("left", "middle"):
        for right, down in ((0.01, 0.0), (0.0, 0.01)):
            state = controls()
            state.drag(button, right, down)
            along, across = seen(state.look.eye) @ [[right, down], [-down, right]]
            assert along > 10 * abs(across)  # an orbit bends its way a little


def test_the_middle_button_holds_what_it_grasps():
    """By projection: the target moves by just as many heights of the window as the mouse."""
    for aspect in (0.5, 1.0, 2.0):
        state = controls()
        state.drag("middle", 0.1, -0.05, aspect=aspect)
        eye = state.look.eye
        x, y, z = eye.rotation.T @ (np.array(START.eye.target) - eye.origin)
        heights = np.array([x, y]) / -z / math.tan(math.radians(eye.fov / 2)) * aspect / 2
        np.testing.assert_allclose(heights, [0.1, 0.05], atol=1e-12)


def test_wheel_and_right_drag_zoom():
    for closer in (lambda state: state.scroll(1), lambda state: state.drag("right", 0, -0.1)):
        state = controls()
        closer(state)
        assert state.look.eye.distance < START.eye.distance
        assert state.look.eye.target == START.eye.target


@given(st.sets(st.sampled_from(WALK_KEYS)), st.lists(st.floats(1e-4, 0.1), min_size=1, max_size=20))
def test_walking_does_not_depend_on_the_frame_rate(held, frames):
    many, one = controls(replace(START, walking=True)), controls(replace(START, walking=True))
    for seconds in frames:
        many.pass_time(held, seconds)
    total = sum(frames)
    for _ in range(100):
        one.pass_time(held, total / 100)
    np.testing.assert_allclose(many.look.eye.origin, one.look.eye.origin, atol=1e-12)
    directions = [("d", "a"), ("space", "control"), ("w", "s")]
    counts = sum((a in held) != (b in held) for a, b in directions)
    walked = np.linalg.norm(many.look.eye.origin - START.eye.origin)
    if counts == 1:  # more: up and forward are not at right angles
        assert walked == pytest.approx(BOUNDS.radius * total)


def test_a_window_that_hung_does_not_throw_its_user_away():
    state = controls(replace(START, walking=True))
    state.pass_time({"w"}, 3600.0)
    assert np.linalg.norm(state.look.eye.origin - START.eye.origin) == pytest.approx(0.1 * BOUNDS.radius)


def test_walking_needs_the_mode():
    state = controls()
    state.pass_time({"w"}, 0.1)
    assert state.look == START
    assert not state.walks({"w"})
    state.press("tab")
    assert state.walks({"w"})
    assert not state.walks({"shift"})
    state.press("tab")
    assert not state.look.walking


def test_looking_round_stays_and_orbit_does_not():
    state = controls(replace(START, walking=True))
    state.drag("left", 0.2, 0.1)
    np.testing.assert_allclose(state.look.eye.origin, START.eye.origin, atol=1e-12)
    assert state.look.eye.target != START.eye.target
    state = controls()
    state.drag("left", 0.2, 0.1)
    assert state.look.eye.target == START.eye.target


def test_bookmarks_keep_and_recall():
    state = controls()
    state.press("f2")
    assert state.look == START
    assert "Shift+F2" in state.message
    state.press("f2", shift=True)
    state.drag("left", 0.3, 0.2)
    assert state.look.eye != START.eye
    state.press("f2")
    assert state.look.eye == START.eye
    assert list(state.bookmarks) == ["f2"]


def test_surroundings_turn_all_round():
    state = controls()
    for _ in range(72):
        state.press("]")
    assert state.look.rotation == pytest.approx(0)
    state.drag("left", 0.5, 0, shift=True)
    assert state.look.rotation == pytest.approx(90)
    assert state.look.eye == START.eye


def test_exposure_and_curves():
    state = controls()
    for key in "++-":
        state.press(key)
    assert state.look.exposure == 0.25
    state.press("0")
    assert state.look.exposure == 0
    seen = [state.press("t") or state.look.curve for _ in range(3)]
    assert sorted(seen) == ["aces", "clamp", "reinhard"]


def test_comparison_looks_through_the_photographs_camera():
    state = controls()
    state.press("n")
    assert (state.look.comparison, state.look.photograph) == ("beside", 0)
    state.press("n")
    assert state.look.photograph == 1
    expected = PHOTOGRAPHS[1].camera_to_world.numpy()
    np.testing.assert_allclose(state.look.eye.camera(8, 6).camera_to_world, expected, atol=1e-12)
    assert state.look.eye.fov == PHOTOGRAPHS[1].fov
    seen = [state.press("c") or state.look.comparison for _ in range(4)]
    assert seen == ["swipe", "difference", "off", "beside"]
    state.press("9")
    assert "3 photographs" in state.message


def test_the_swipe_follows_the_mouse_and_another_camera_ends_it():
    state = controls(replace(START, comparison="swipe"))
    state.drag("left", 0.5, 0.3, aspect=2.0)
    assert state.look.edge == 0.75
    assert state.look.comparison == "swipe"
    state.drag("left", 9, 0)
    assert state.look.edge == 1
    state.scroll(1)
    assert state.look.comparison == "off"
    assert "photograph's camera" in state.message


def test_without_photographs_the_keys_say_so():
    state = controls(photographs=())
    for key in "cn1":
        state.press(key)
        assert state.look == START
        assert "--photograph" in state.message
