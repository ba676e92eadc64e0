"""`--refine-pose`: photographs by Mitsuba, cameras that are off, and what comes back."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.fitter.poses import photometric_alignment, refinement
from fit_material.fitter.result.schema import read_result
from fit_material.renderer.cameras.pose_offset import DEGREES, SHARE, Pose
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.scene.scene_file import camera_of, read_scene, read_shape
from tests.bench.pose import placed_otherwise
from tests.renderer.cameras.test_pose_offset import left

SIZE = 40  # of the photographs in `gold_photographs`
FIDELITY = replace(PRESETS["preview"], pixels=400)


def poses(scene: Path) -> list[Pose]:
    found = read_scene(scene)
    shape = read_shape(found.geometry)
    return [Pose.of(camera_of(spec.camera, SIZE, SIZE), shape) for spec in found.photographs]


def misplaced(scene: Path, *motions: tuple[float, ...]) -> Path:
    """The same photographs by cameras that are moved, in degrees and shares of the distance."""
    units = torch.tensor([DEGREES] * 3 + [SHARE] * 3, dtype=torch.float64)
    path = scene.with_name("misplaced.toml")
    moved = [torch.tensor(each, dtype=torch.float64) / units for each in motions]
    path.write_text(placed_otherwise(read_scene(scene), moved), encoding="utf-8")
    return path


def test_cameras_come_back_to_where_they_stood(gold_scene, tmp_path, monkeypatch):
    """The turn about the line of sight and the way round the ball as well, which its outline does not tell."""
    monkeypatch.setattr(refinement, "EFFORTS", ((400, 256, 2),))
    monkeypatch.setattr(photometric_alignment, "SLOPE_SAMPLES", 512)
    wrong = misplaced(gold_scene, (0.9, -0.6, 1.6, 0.004, 0.006, 0.007), (-0.7, 0.5, -1.8, 0.008, -0.003, -0.005))
    options = FitOptions(FIDELITY, type="metal", refine_pose=True, command="fit-material fit --refine-pose")
    result = fit_scene(wrong, tmp_path / "out", options)
    assert result == read_result(tmp_path / "out" / "result.json")
    assert result.cameras is not None
    for true, was, found in zip(poses(gold_scene), poses(wrong), result.cameras, strict=True):
        camera = replace(true.given, camera_to_world=torch.tensor(found.matrix, dtype=torch.float64))
        degrees, share = left(Pose.of(camera, read_shape(read_scene(gold_scene).geometry)), true.given)
        before, _ = left(was, true.given)
        assert degrees < before / 2  # by outlines alone the turn about the line of sight stays, four fifths of it
        assert (
            degrees < 6 * found.stderr_degrees
        )  # stated by two hundred pixels of few paths: they fall short themselves
        assert 100 * share < 6 * found.stderr_percent
        assert found.degrees == pytest.approx(before, abs=degrees + 1e-6)  # how far it went: by the triangle
    assert "Cameras were moved, by up to" in result.message
    assert "camera turned by" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    given = tmp_path / "given.toml"
    text = re.sub(r"\[photographs\.camera\]\nfov.*\nmatrix.*\n", "", wrong.read_text(encoding="utf-8"))
    given.write_text('cameras = "out/sphere.transforms.json"\n' + text, encoding="utf-8")
    for spec, found in zip(read_scene(given).photographs, result.cameras, strict=True):
        np.testing.assert_allclose(np.array(spec.camera.matrix), np.array(found.matrix), rtol=0, atol=1e-12)
        assert spec.camera.fov == pytest.approx(read_scene(wrong).photographs[0].camera.fov)


@pytest.mark.slow  # a fit
def test_without_being_asked_nothing_is_told_of_cameras(gold_scene, tmp_path):
    fit_scene(gold_scene, tmp_path / "out", FitOptions(FIDELITY, type="metal"))
    assert "cameras" not in json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert not list((tmp_path / "out").glob("*.transforms.json"))


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        (
            (0, 0, 0, 0, 0, 0.06),
            r"photographs\[1\]\.camera: is off by 0\.\d° and 5\.\d% of its distance, expected a pose",
        ),
        ((0, 12.0, 0, 0, 0, 0), r"photographs\[1\]\.mask: is .* expected a mask of the object and nothing else"),
    ],
    ids=["too far away", "turned away"],
)
def test_what_is_no_small_error_is_refused(gold_scene, tmp_path, motion, said):
    wrong = misplaced(gold_scene, (0,) * 6, motion)
    with pytest.raises(InputError, match=said):
        fit_scene(wrong, tmp_path / "out", FitOptions(FIDELITY, type="metal", refine_pose=True))
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())
