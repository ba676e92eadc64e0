"""What changes nothing in a scene changes nothing in its result, from files to files."""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.result.schema import FittedMaterial, Result
from fit_material.shaders.materials.types import Matte, Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.support.modelled import Modelled, written
from tests.support.soft_scene import soft_light

FEW = replace(
    PRESETS["preview"], pixels=400, search_pixels=200, samples=64, search_samples=16, footprint=1, search_levels=8
)
CONVEX = ("self-visibility", "ambient-occlusion", "interreflection")  # what no ball needs, and what takes long to see
KEYS = ("f0", "n", "k")
TURNED = [2, 0, 1]  # red, green and blue as blue, red, green
OF_FILES = {"time", "inputs", "outputs", "earlier_outputs"}  # what differs with names of files, and with seconds


def float64(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


GOLD = Metal(float64(0.146, 0.425, 1.431), float64(3.578, 2.326, 1.85), Microfacet(torch.tensor(0.25).double()))
BALL = Modelled({"ball": GOLD}, soft_light(16), azimuths=(0.0, 100.0), size=14, noise=0.01)
SLICES = replace(
    BALL,
    materials={
        "clay": Matte(float64(0.5, 0.3, 0.2), float64(1, 1, 1)),
        "chalk": Matte(float64(0.8, 0.7, 0.6), float64(1, 1, 1)),
    },
)


def fitted(scene_file: Path, kind: str = "metal") -> Result:
    return fit_scene(scene_file, scene_file.parent / "out", FitOptions(FEW, type=kind, unwanted=CONVEX))


def told(result: Result) -> dict:
    """All but the files' names and sums, and the seconds."""
    return result.model_dump(exclude=OF_FILES)


def assert_alike(one: FittedMaterial, other: FittedMaterial, order: Sequence[int] = (0, 1, 2)) -> None:
    """Two fits whose integrations, or whose photographs' noise, were drawn apart.

    Each is off by its stated standard error, so that their difference is within four of √2.
    """
    assert other.alpha == pytest.approx(one.alpha, abs=4 * math.hypot(one.stderr.alpha or 0, other.stderr.alpha or 0))
    compared = 0
    for key in KEYS:
        for channel, moved in enumerate(order):
            errors = getattr(one.stderr, key)[channel], getattr(other.stderr, key)[moved]
            if None not in errors:
                difference = getattr(other, key)[moved] - getattr(one, key)[channel]
                assert abs(difference) <= 4 * math.hypot(*errors), (key, channel)
                compared += 1
    assert compared >= 3  # F0 is always known


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> Result:
    return fitted(written(BALL, tmp_path_factory.mktemp("ball")))


@pytest.fixture(scope="module")
def slices(tmp_path_factory) -> tuple[Path, Result]:
    scene = written(SLICES, tmp_path_factory.mktemp("slices"))
    return scene, fitted(scene, "matte")


@pytest.mark.slow
def test_brighter_light_and_photographs_change_no_digit(ball, tmp_path):
    """By a power of two, which every sum and product takes without rounding."""
    assert told(fitted(written(replace(BALL, brightness=1024.0), tmp_path))) == told(ball)


def test_scene_and_light_turned_together(ball, tmp_path):
    (one,), (other,) = ball.materials, fitted(written(replace(BALL, rotation=90.0), tmp_path)).materials
    assert_alike(one, other)


@pytest.mark.slow
def test_views_in_another_order(ball, tmp_path):
    result = fitted(written(replace(BALL, azimuths=BALL.azimuths[::-1]), tmp_path))
    assert_alike(ball.materials[0], result.materials[0])
    names = [view.name for view in ball.quality.photographs]
    assert [view.name for view in result.quality.photographs] == names[::-1]


def test_channels_in_another_order(ball, tmp_path):
    gold = replace(GOLD, n=GOLD.n[TURNED], k=GOLD.k[TURNED])
    result = fitted(written(replace(BALL, materials={"ball": gold}, light=BALL.light[..., TURNED]), tmp_path))
    assert_alike(ball.materials[0], result.materials[0], np.argsort(TURNED).tolist())


def test_renamed_photographs_and_materials_change_their_names_alone(slices, tmp_path):
    scene, result = slices
    shutil.copytree(scene.parent, tmp_path / "renamed", ignore=shutil.ignore_patterns("out"))
    copy = tmp_path / "renamed" / "scene.toml"
    (copy.parent / "view_0.exr").rename(copy.parent / "zenith.exr")
    for file, before, after in ((copy, "view_0", "zenith"), (copy.parent / "ball.obj", "clay", "terracotta")):
        file.write_text(file.read_text().replace(before, after))
    renamed = fitted(copy, "matte").model_dump_json(exclude=OF_FILES)
    expected = result.model_dump_json(exclude=OF_FILES)
    assert renamed == expected.replace("view_0", "zenith").replace("clay", "terracotta") != expected


def test_slices_and_views_in_another_order(slices, tmp_path):
    """The mesh's groups the other way round, and the photographs: pixels are only drawn in another order.

    Their diffuse light is no chance's, and all of them are taken: what is left is where the solver stops, at steps of
    1e-6, once by each estimate of the noise, some ten times; 1e-4 is ten times their sum.
    """
    scene, result = slices
    shutil.copytree(scene.parent, tmp_path / "other", ignore=shutil.ignore_patterns("out"))
    mesh = tmp_path / "other" / "ball.obj"
    vertices, *groups = mesh.read_text().split("usemtl ")
    mesh.write_text(vertices + "".join(f"usemtl {group}" for group in reversed(groups)))
    copy = mesh.with_name("scene.toml")
    head, *photographs = copy.read_text().split("[[photographs]]")
    copy.write_text(head + "".join(f"[[photographs]]{each}" for each in reversed(photographs)))
    other = {material.name: material for material in fitted(copy, "matte").materials}
    assert [*other] == [material.name for material in reversed(result.materials)]
    for one in result.materials:
        assert other[one.name].color == pytest.approx(one.color, rel=1e-4)
