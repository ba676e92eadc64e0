"""A turn round the model, frame by frame; names for pictures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from PIL import Image

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.viewer.eye import Eye
from fit_material.renderer.viewer.turntable import free_name, turntable

EYE = Eye((1.0, 2.0, 3.0), 4.0, yaw=0.5, pitch=-0.2)


class Draws:
    """Codes that tell the frame's number; remembers the eyes."""

    def __init__(self) -> None:
        self.eyes: list[Eye] = []

    def __call__(self, eye: Eye) -> np.ndarray:
        self.eyes.append(eye)
        return np.full((2, 3, 3), len(self.eyes) % 256, np.uint8)


def test_frames_go_once_round(tmp_path):
    draw = Draws()
    assert list(turntable(tmp_path / "film", EYE, 8, draw)) == [1, 2, 3, 4, 5, 6, 7, 8]
    names = sorted(path.name for path in (tmp_path / "film").iterdir())
    assert names == [f"frame_00{index}.png" for index in range(8)]
    assert np.array(Image.open(tmp_path / "film" / "frame_004.png"))[0, 0, 0] == 5
    assert draw.eyes[0] == EYE
    azimuth = np.unwrap([math.atan2(eye.origin[0] - 1, eye.origin[2] - 3) for eye in draw.eyes])
    np.testing.assert_allclose(np.diff(azimuth), 2 * math.pi / 8)
    assert {round(eye.origin[1], 12) for eye in draw.eyes} == {round(EYE.origin[1], 12)}


def test_names_sort_as_the_frames_do(tmp_path):
    list(turntable(tmp_path, EYE, 1002, Draws()))
    names = sorted(path.name for path in tmp_path.iterdir())
    assert (names[0], names[-1], len(names)) == ("frame_0000.png", "frame_1001.png", 1002)


def test_given_up_it_leaves_nothing(tmp_path):
    film = turntable(tmp_path / "film", EYE, 8, Draws())
    next(film)
    film.close()
    assert not list(tmp_path.iterdir())


def test_frames_of_another_film_are_not_mixed_in(tmp_path):
    list(turntable(tmp_path, EYE, 8, Draws()))
    with pytest.raises(InputError, match=r"frame_004\.png"):
        list(turntable(tmp_path, EYE, 4, Draws()))
    list(turntable(tmp_path, EYE, 8, Draws()))
    assert len(list(tmp_path.iterdir())) == 8


@pytest.mark.parametrize("frames", [-1, 0, 1, 100_001])
def test_how_many_frames_there_can_be(tmp_path, frames):
    with pytest.raises(InputError, match=f"--frames: is {frames}, expected 2 to"):
        next(turntable(tmp_path / "film", EYE, frames, Draws()))
    assert not list(tmp_path.iterdir())


def test_a_free_name_is_free_for_all_endings(tmp_path):
    assert free_name(tmp_path, "a", ".png", ".exr") == tmp_path / "a-001"
    (tmp_path / "a-001.exr").touch()
    (tmp_path / "a-002.png").touch()
    (tmp_path / "a-003.txt").touch()
    assert free_name(tmp_path, "a", ".png", ".exr") == tmp_path / "a-003"
