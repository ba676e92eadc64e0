"""The window itself, under Xvfb and driven by xdotool where they are installed; and without any display."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from PIL import Image

from fit_material.renderer.errors.input_error import InputError
from tests.renderer.viewer.test_session import CUBE, METAL

T = TypeVar("T")

SIZE = 320, 200
PATIENCE = 60  # seconds for what takes one or two; the machine may be shared

# a fresh process, since a window wants the main thread and an environment of its own
PROGRAM = f"""
from pathlib import Path
from typing import TypeVar
import torch
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.viewer_model.model import read_model
from fit_material.renderer.viewer_model.viewer_light import surroundings
from fit_material.renderer.viewer.eye import Eye
from fit_material.renderer.viewer.look import Look
from fit_material.renderer.viewer.session import Subject
from fit_material.renderer.viewer.window import run
light = surroundings(Environment(torch.rand(8, 16, 3, generator=torch.Generator().manual_seed(1))), size=32)
look = Look(Eye((0.0, 0.0, 0.0), 7.0, 0.4, -0.4))
run(Subject(lambda: read_model("cube.obj"), light, look, antialias=2), {SIZE})
"""


def wait_for(found: Callable[[], T]) -> T:
    """What `found` returns, once that is something."""
    end = time.monotonic() + PATIENCE
    while not (value := found()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)
    return value


@pytest.fixture
def display() -> Iterator[str]:
    """The name of a display that nobody sees."""
    if not (shutil.which("Xvfb") and shutil.which("xdotool")):
        pytest.skip("Xvfb or xdotool is absent")
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "800x600x24"],
        pass_fds=[write],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as pipe:
        number = pipe.readline().strip()
    try:
        if not number:
            pytest.skip("Xvfb does not start here")
        yield f":{number}"
    finally:
        server.terminate()
        server.wait()


class Viewer:
    """A viewer in a process of its own, in the folder of its model."""

    def __init__(self, folder: Path, display: str) -> None:
        self.environment = {**os.environ, "DISPLAY": display, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.getcwd()}
        self.environment.pop("WAYLAND_DISPLAY", None)
        self.process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM], cwd=folder, env=self.environment, stderr=subprocess.PIPE, text=True
        )

    def wait_for_window(self) -> None:
        self.window = wait_for(lambda: self.xdotool("search", "--name", "^cube — H shows")).split()[0]
        self.xdotool("mousemove", "--sync", "160", "100")  # without a window manager, keys go where the mouse is

    def xdotool(self, *words: str) -> str:
        assert self.process.poll() is None, self.process.stderr and self.process.stderr.read()
        return subprocess.run(
            ["xdotool", *words], env=self.environment, capture_output=True, text=True, check=False
        ).stdout

    def title(self) -> str:
        return self.xdotool("getwindowname", self.window).strip()


@pytest.fixture
def viewer(display, tmp_path) -> Iterator[Viewer]:
    (tmp_path / "cube.obj").write_text(CUBE, "utf-8")
    (tmp_path / "cube.thesis.mtl").write_text(METAL, "utf-8")
    started = Viewer(tmp_path, display)
    with started.process:
        try:
            started.wait_for_window()
            yield started
        finally:
            started.process.kill()


def test_keys_and_mouse_reach_the_picture(viewer, tmp_path):
    def picture(number: int) -> np.ndarray:
        viewer.xdotool("key", "p")
        wait_for(lambda: f"cube-{number:03}" in viewer.title())
        return np.array(Image.open(tmp_path / f"cube-{number:03}.png")).astype(int)

    first = picture(1)
    assert first.shape == (SIZE[1], SIZE[0], 3)
    viewer.xdotool("mousedown", "1", "mousemove_relative", "--sync", "60", "30", "mouseup", "1")
    turned = picture(2)
    assert np.abs(turned - first).max() > 20
    viewer.xdotool("key", "plus")
    wait_for(lambda: "exposure +0.25" in viewer.title())
    viewer.xdotool("click", "4")
    brighter = picture(3)
    assert brighter.mean() > turned.mean()
    viewer.xdotool("keydown", "shift", "key", "F2", "keyup", "shift")
    wait_for((tmp_path / "cube.cameras.toml").exists)
    (tmp_path / "cube.thesis.mtl").write_text("newmtl paint\nNs two\n", "utf-8")
    wait_for(lambda: "cube.thesis.mtl" in viewer.title())
    viewer.xdotool("key", "Escape")
    assert viewer.process.wait(PATIENCE) == 0
    _, stderr = viewer.process.communicate()
    assert "Traceback" not in stderr
    assert stderr.count("\n") == 4  # three pictures and the broken file


def test_without_a_display_there_is_a_remedy(monkeypatch):
    from fit_material.renderer.viewer.window import _window

    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform != "linux":
        pytest.skip("there is always a display")
    sentence = r"view: expected a display \(.*\); without one use --screenshot FILE"
    with pytest.raises(InputError, match=sentence), _window((9, 9), ""):
        pass
