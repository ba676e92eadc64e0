"""What a window does, off screen: pictures, films, reading anew, and sentences instead of crashes."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.viewer import session as session_module
from fit_material.renderer.viewer.compare import Photographs
from fit_material.renderer.viewer.eye import Eye
from fit_material.renderer.viewer.look import Look
from fit_material.renderer.viewer.session import Session, Subject
from fit_material.renderer.viewer_model.model import read_model
from fit_material.renderer.viewer_model.viewer_light import surroundings
from fit_material.shaders.tone_mapping import tone_mapped

SIZE = 24, 16
CUBE = """mtllib cube.thesis.mtl
v -1 -1 -1
v 1 -1 -1
v 1 1 -1
v -1 1 -1
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
usemtl paint
f 1 4 3 2
f 5 6 7 8
f 1 5 8 4
f 2 3 7 6
f 1 2 6 5
f 4 8 7 3
"""
MATTE = "newmtl paint\nNs 0\nKd {0} 0.1 0.1\nKa 1 1 1\nKs 0 0 0\n"
METAL = "newmtl paint\nNs 2\nKd 0.2 0.9 1.1\nKa 3.9 2.4 2.3\nKs 0.1 0.1 0.1\n"


def uneven() -> Environment:
    """Light that is different from everywhere."""
    row, column = torch.meshgrid(torch.arange(32), torch.arange(64), indexing="ij")
    red = 0.5 + 0.4 * torch.sin(column * (2 * torch.pi / 64))
    blue = 0.5 + 0.4 * torch.cos(column * (4 * torch.pi / 64) + row * 0.1)
    return Environment(torch.stack([red, row / 32, blue], -1))


class Screen:
    """Stands for the window's framebuffer."""

    def __init__(self, gl) -> None:
        self.framebuffer = gl.framebuffer([gl.renderbuffer(SIZE, 4)])

    def pixels(self) -> np.ndarray:
        read = self.framebuffer.read(components=3, alignment=1, viewport=(0, 0, *SIZE))
        return np.frombuffer(read, np.uint8).reshape(SIZE[1], SIZE[0], 3)[::-1].astype(int)


@pytest.fixture
def screen(gl):
    return Screen(gl)


@pytest.fixture
def begin(gl, tmp_path):
    """Begin a session about the cube in `tmp_path`."""
    begun = []
    (tmp_path / "cube.obj").write_text(CUBE, "utf-8")
    write(tmp_path / "cube.thesis.mtl", MATTE.format(0.8))
    light = surroundings(uneven(), size=32)

    def start(photographs: Photographs | None = None, yaw: float = 0.4, rotation: float = 0.0) -> Session:
        look = Look(Eye((0.0, 0.0, 0.0), 7.0, yaw, -0.4), rotation=rotation)

        def read():
            return read_model(tmp_path / "cube.obj")

        session = Session(gl, Subject(read, light, look, photographs, antialias=2, out=tmp_path), read())
        session.size = SIZE
        begun.append(session)
        return session

    yield start
    for session in begun:
        session.release()


def write(path: Path, text: str) -> None:
    """Write a file with a time of its own, however coarse the file system's clock."""
    later = path.stat().st_mtime_ns + 10**9 if path.exists() else None
    path.write_text(text, "utf-8")
    if later:
        os.utime(path, ns=(later, later))


def finish(session: Session, screen: Screen) -> np.ndarray:
    """Draw until there is nothing left to do."""
    for _ in range(100_000):  # a moment passes before a picture is taken to be at rest
        if not session.busy:
            return screen.pixels()
        session.film()
        session.draw(screen.framebuffer)
    raise AssertionError("it never comes to rest")


def look_twice(session: Session) -> None:
    session.look_for_changes()
    session.look_for_changes()


def test_it_rests_when_nothing_happens(begin, screen):
    session = begin()
    picture = finish(session, screen)
    assert not session.busy
    assert np.ptp(picture) > 50
    session.refresh()
    assert session.busy
    np.testing.assert_array_equal(finish(session, screen), picture)


def test_turned_surroundings_are_turned_for_sky_ambient_light_and_reflections(begin, screen, tmp_path):
    """A cube looks the same from all four sides: turning camera and light together by 90° changes nothing."""
    for text in (MATTE.format(0.8), METAL):
        write(tmp_path / "cube.thesis.mtl", text)
        here = finish(begin(), screen)
        there = finish(begin(yaw=0.4 + np.pi / 2, rotation=90.0), screen)
        assert np.abs(here - finish(begin(rotation=90.0), screen)).max() > 20
        # float32 turns directions by 1e-7, which the slope of the light and of its cubemap's texels makes less than
        # a code of; codes that lie at a rounding's edge change by one
        assert np.abs(here - there).max() <= 1


def test_a_slow_picture_is_coarse_while_it_moves_and_whole_at_rest(begin, screen, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(session_module.time, "perf_counter", lambda: now[0])
    session = begin()
    finish(session, screen)
    session._pace.measure(60.0)
    session.drag("left", 0.1, 0.0)
    session.draw(screen.framebuffer)
    moving = screen.pixels()
    assert session.busy
    now[0] = 10.0
    whole = finish(session, screen)
    other = begin()
    other.drag("left", 0.1, 0.0)
    now[0] = 20.0
    np.testing.assert_array_equal(whole, finish(other, screen))
    assert np.abs(moving - whole).max() > 20  # edges are not where they were drawn
    assert np.abs(moving.mean((0, 1)) - whole.mean((0, 1))).max() < 10  # but it is the same picture


def test_a_picture_is_saved_as_png_and_exr_under_a_free_name(begin, screen, tmp_path, capsys):
    session = begin()
    session.press("+")
    for _ in range(2):
        session.press("p")
    assert sorted(path.name for path in tmp_path.glob("cube-*")) == [
        "cube-001.exr", "cube-001.png", "cube-002.exr", "cube-002.png"
    ]  # fmt: skip
    linear = read_image(tmp_path / "cube-001.exr")
    codes = np.array(Image.open(tmp_path / "cube-001.png")).astype(int)
    expected = 255 * tone_mapped(torch.from_numpy(linear.radiance), 0.25, "clamp").numpy()
    assert np.abs(codes - expected).max() <= 0.5 + 1e-3
    assert linear.alpha is not None
    assert 0.05 < linear.alpha.mean() < 0.5
    np.testing.assert_array_equal(finish(session, screen), codes)
    assert f"saved {tmp_path / 'cube-001.png'}" in capsys.readouterr().err


def test_a_changed_material_is_read_again(begin, screen, tmp_path):
    session = begin()
    before = finish(session, screen)
    write(tmp_path / "cube.thesis.mtl", MATTE.format(0.2))
    look_twice(session)
    assert session.title == "read again"
    after = finish(session, screen)
    assert (before - after)[SIZE[1] // 2, SIZE[0] // 2, 0] > 20
    assert np.abs(before - after)[..., 1:].max() <= 1


def test_a_broken_file_keeps_the_picture_and_is_told(begin, screen, tmp_path, capsys):
    session = begin()
    before = finish(session, screen)
    write(tmp_path / "cube.thesis.mtl", MATTE.format("nan"))
    look_twice(session)
    assert "cube.thesis.mtl" in session.title
    assert "nan" in session.title
    assert capsys.readouterr().err.count("\n") == 1
    np.testing.assert_array_equal(finish(session, screen), before)
    write(tmp_path / "cube.thesis.mtl", MATTE.format(0.2))
    look_twice(session)
    assert (before - finish(session, screen)).max() > 20


def test_a_turntable_is_drawn_between_events(begin, screen, tmp_path, monkeypatch):
    monkeypatch.setattr(session_module, "FRAMES", 4)
    session = begin()
    first = finish(session, screen)
    session.press("m")
    session.film()
    assert "1 of 4" in session.title
    finish(session, screen)
    frames = sorted((tmp_path / "cube-turntable-001").iterdir())
    assert len(frames) == 4
    pictures = [np.array(Image.open(frame)).astype(int) for frame in frames]
    np.testing.assert_array_equal(pictures[0], first)
    assert np.abs(pictures[1] - pictures[0]).max() > 20
    assert "saved" in session.title


def test_escape_gives_a_turntable_up_before_it_quits(begin, screen, tmp_path):
    session = begin()
    session.press("m")
    session.film()
    session.press("escape")
    assert not session.wants_to_quit
    assert not list(tmp_path.glob("cube-turntable-*/*"))
    assert not list(tmp_path.glob("cube-turntable-*/.*"))
    finish(session, screen)
    session.press("escape")
    assert session.wants_to_quit


def test_kept_cameras_are_there_the_next_time(begin):
    session = begin()
    session.press("f1", shift=True)
    kept = session.controls.look.eye
    again = begin(yaw=2.0)
    again.press("f1")
    np.testing.assert_allclose(again.controls.look.eye.origin, kept.origin, atol=1e-12)


def test_broken_cameras_are_told_and_left_alone(begin, tmp_path, capsys):
    path = tmp_path / "cube.cameras.toml"
    path.write_text("[F1", "utf-8")
    session = begin()
    assert "cube.cameras.toml" in session.title
    session.press("f1", shift=True)
    assert path.read_text("utf-8") == "[F1"
    assert capsys.readouterr().err.count("cube.cameras.toml") == 2


def test_a_photograph_that_cannot_be_read_ends_the_comparison(begin, screen, tmp_path):
    from tests.renderer.viewer.test_compare import write_scene

    photographs = Photographs(write_scene(tmp_path))
    (tmp_path / "two.exr").write_bytes(b"broken")
    session = begin(photographs)
    session.press("c")
    assert session.controls.look.comparison == "beside"
    finish(session, screen)
    session.press("n")
    picture = finish(session, screen)
    assert session.controls.look.comparison == "off"
    assert "two.exr" in session.title
    assert np.ptp(picture) > 50


def test_a_swipe_leaves_the_render_as_fine_as_it_is(begin, screen, tmp_path):
    from tests.renderer.viewer.test_compare import write_scene

    session = begin(Photographs(write_scene(tmp_path)))
    session._pace.measure(60.0)
    for _ in range(2):
        session.press("c")
    assert session.controls.look.comparison == "swipe"
    finish(session, screen)
    session._pace.measure(60.0)
    for share in (-1.0, 0.2, 0.2):  # by heights of a window that is 1.5 as wide
        session.drag("left", share, 0.0)
        session.draw(screen.framebuffer)
        assert not session.busy
    assert session.controls.look.edge == pytest.approx(0.4 / 1.5)


def test_help_is_printed(begin, capsys):
    session = begin()
    session.press("?")
    assert "Shift+F1–F4" in capsys.readouterr().out
    assert "terminal" in session.title
