"""Kept cameras: what is written is what comes back, and nothing that stood in the file is lost."""

from __future__ import annotations

import math
import tempfile
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.viewer.bookmarks import Bookmarks, bookmarks_file, read_bookmarks
from fit_material.renderer.viewer.eye import Eye

EYE = Eye((1.0, 2.0, 3.0), 4.0, yaw=0.5, pitch=-0.2)

coordinates = st.floats(-1e3, 1e3)
eyes = st.builds(
    Eye,
    target=st.tuples(coordinates, coordinates, coordinates),
    distance=st.floats(0.1, 1e3),
    yaw=st.floats(-math.pi, math.pi),
    pitch=st.one_of(st.floats(-math.pi / 2, math.pi / 2), st.sampled_from([-math.pi / 2, math.pi / 2])),
    roll=st.sampled_from([0.0, 0.7]),
    projection=st.sampled_from(["perspective", "orthographic"]),
    fov=st.floats(1, 120),
    scale=st.floats(1e-3, 1e3),
)


@given(st.dictionaries(st.sampled_from(["f1", "f2", "f3", "f4"]), eyes, min_size=1))
def test_kept_cameras_come_back(kept):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ball.cameras.toml"
        bookmarks = Bookmarks(path)
        for key, eye in kept.items():
            bookmarks[key] = eye
        found = read_bookmarks(path)
    assert found.keys() == kept.keys()
    for key, eye in kept.items():
        one, other = (e.camera(4, 3) for e in (eye, found[key]))
        # directions are differences of positions up to 2e3, over distances down to 0.1: 2e3 · 2e-16 / 0.1 · a few
        np.testing.assert_allclose(one.camera_to_world, other.camera_to_world, atol=3e-11)
        np.testing.assert_allclose(found[key].target, eye.target, atol=1e-9)
        assert one.projection == other.projection
        assert (one.fov == other.fov) if eye.projection == "perspective" else (one.scale == other.scale)


def test_the_file_lies_beside_the_model_in_the_words_of_scene_toml(tmp_path):
    path = bookmarks_file(tmp_path / "red.ball.obj")
    assert path == tmp_path / "red.ball.cameras.toml"
    Bookmarks(path)["f3"] = EYE
    table = tomllib.loads(path.read_text("utf-8"))["F3"]
    assert table.keys() == {"origin", "target", "up", "fov"}
    assert table["target"] == [1.0, 2.0, 3.0]
    assert list(tmp_path.iterdir()) == [path]


def test_without_a_file_there_are_none(tmp_path):
    bookmarks = Bookmarks(tmp_path / "x.cameras.toml")
    bookmarks.load()
    assert not bookmarks
    assert not list(tmp_path.iterdir())


def test_two_windows_do_not_lose_each_others_cameras(tmp_path):
    path = tmp_path / "x.cameras.toml"
    one, other = Bookmarks(path), Bookmarks(path)
    one["f1"] = EYE
    other["f2"] = EYE
    one["f4"] = EYE
    assert read_bookmarks(path).keys() == {"f1", "f2", "f4"}
    assert one.keys() == {"f1", "f2", "f4"}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[F1", "TOML"),
        ("[F1]\norigin = [0, 0, 1]\n", 'F1: is "origin", expected either origin and target, or matrix'),
        ("[F1]\norigin = [0, 0, nan]\ntarget = [0, 0, 0]\n", "F1.origin[2]: is nan, expected a finite number"),
        ("[F1]\norigin = [0, 0, 1]\ntarget = [0, 0, 0]\nfov = 500.0\n", "F1.fov: is 500.0"),
        ("[F5]\norigin = [0, 0, 1]\ntarget = [0, 0, 0]\n", "the nearest is F"),
        ("\0", "TOML"),
    ],
)
def test_a_broken_file_is_told_and_left_alone(tmp_path, text, sentence):
    path = tmp_path / "x.cameras.toml"
    path.write_text(text, "utf-8")
    bookmarks = Bookmarks(path)
    with pytest.raises(InputError, match=r"x\.cameras\.toml") as told:
        bookmarks.load()
    assert sentence in str(told.value)
    with pytest.raises(InputError):
        bookmarks["f1"] = EYE
    assert path.read_text("utf-8") == text
    assert bookmarks["f1"] == EYE  # until the viewer is closed


def test_once_mended_the_file_takes_what_was_kept_meanwhile(tmp_path):
    path = tmp_path / "x.cameras.toml"
    path.write_text("[F1", "utf-8")
    bookmarks = Bookmarks(path)
    with pytest.raises(InputError):
        bookmarks["f2"] = EYE
    path.unlink()
    bookmarks["f3"] = EYE
    assert read_bookmarks(path).keys() == {"f2", "f3"}


def test_a_folder_that_cannot_be_written(tmp_path):
    bookmarks = Bookmarks(tmp_path / "gone" / "x.cameras.toml")
    with pytest.raises(InputError, match="can be written"):
        bookmarks["f1"] = EYE
    assert bookmarks["f1"] == EYE


def test_a_camera_given_as_a_matrix_can_be_turned_round(tmp_path):
    path = tmp_path / "x.cameras.toml"
    path.write_text("[F1]\nmatrix = [[1.0,0.0,0.0,5.0],[0.0,1.0,0.0,6.0],[0.0,0.0,1.0,7.0],[0.0,0.0,0.0,1.0]]\n")
    eye = read_bookmarks(path)["f1"]
    assert eye.target == (5, 6, 6)
    np.testing.assert_allclose(eye.origin, [5, 6, 7])
