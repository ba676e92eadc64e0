"""An effect defined in this file alone is planned, simulated and reported; its rule leaves it out, or a user."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import mitsuba
import numpy as np
import pytest
import torch

from fit_material.fitter.effects.plan_rules import RULES, EffectRule, Facts
from fit_material.fitter.forward.pixel_effects import PIXEL_EFFECTS, PixelEffect, SeenPixels
from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.result.schema import FittedMaterial, Result
from fit_material.shaders.effects import EFFECTS, Effect
from fit_material.shaders.optics import fresnel
from tests.support.registries import added
from tests.support.soft_scene import gold, soft_scene

NAME, DIMMED = "rim-darkening", 0.4


def factor(n_dot_v):
    """1 - 0.4 (1 - n·v)²: light that a lens loses towards the rim of the object."""
    return 1 - DIMMED * (1 - n_dot_v) ** 2


@dataclass(frozen=True)
class DimmedPixels(PixelModel):
    model: PixelModel
    dimmed: torch.Tensor

    @property
    def table(self):
        return self.model.table

    def under(self, table):
        return replace(self, model=self.model.under(table))

    def radiance(self, material):
        return self.dimmed * self.model.radiance(material)


def dim(model: PixelModel, seen: SeenPixels) -> PixelModel:
    return DimmedPixels(model, factor(seen.surface.n_dot_v.double()).mean(1, keepdim=True))


def in_the_viewer(facts: Facts) -> str | None:
    return "the viewer has no lens" if facts.blurs else None


EFFECT = Effect(NAME, "darker rims", "a lens loses light", 0.0, f"{__name__}.dim")


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    with (
        added(EFFECTS, EFFECT),
        added(RULES, EffectRule(NAME, (in_the_viewer,))),
        added(PIXEL_EFFECTS, PixelEffect(NAME, dim)),
    ):
        yield


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    """A gold ball, photographed by Mitsuba and darkened in numpy."""
    path = soft_scene(tmp_path_factory.mktemp("rim"), gold(0.2), views=2, size=32, spp=512)
    for photograph in tomllib.loads(path.read_text())["photographs"]:
        file, camera = path.parent / photograph["image"], photograph["camera"]
        picture = np.array(mitsuba.Bitmap(str(file)).convert(component_format=mitsuba.Struct.Type.Float32))
        picture[..., :3] *= factor(cosines(camera, len(picture)))[..., None].astype(np.float32)
        mitsuba.Bitmap(picture).write(str(file))
    return path


def cosines(camera: dict, size: int) -> np.ndarray:
    """n·v on the unit ball through each pixel's centre; 0 beside it."""
    origin, target = np.array(camera["origin"]), np.array(camera["target"])
    forward = (target - origin) / np.linalg.norm(target - origin)
    right = np.cross(forward, camera["up"])
    right /= np.linalg.norm(right)
    place = ((np.arange(size) + 0.5) / size * 2 - 1) * math.tan(math.radians(camera["fov"] / 2))
    rays = forward + place[None, :, None] * right - place[:, None, None] * np.cross(right, forward)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.sqrt(np.maximum(1 - (origin @ origin - (rays @ origin) ** 2), 0))


def fitted(scene: Path, folder: Path, fidelity: str = "preview", **options) -> Result:
    return fit_scene(scene, folder, FitOptions(PRESETS[fidelity], type="metal", **options))


def worst(material: FittedMaterial) -> float:
    """Largest error of F0, over its standard error."""
    known = gold()
    f0 = fresnel.normal_reflectance(*(torch.tensor(each, dtype=torch.float64) for each in (known.n, known.k))).numpy()
    return float(np.max(np.abs(np.array(material.f0) - f0) / np.array(material.stderr.f0)))


def test_an_effect_of_this_file_is_planned_and_simulated(scene, tmp_path):
    """At the rim 0.4 of the light is lost, so that a tenth of the ball's pixels at least loses a hundredth of it. With
    the effect F0 is right by its own errors; without, it is not."""
    result = fitted(scene, tmp_path / "with")
    (decision,) = (each for each in result.effects if each.name == NAME)
    assert decision.on
    assert "of their light, up to" in decision.why
    assert worst(result.materials[0]) < 4
    assert NAME in (tmp_path / "with" / "report.html").read_text()
    bare = fitted(scene, tmp_path / "without", unwanted=(NAME,))
    (decision,) = (each for each in bare.effects if each.name == NAME)
    assert not decision.on
    assert decision.why.startswith("--without overrules: ")
    assert bare.quality.overall.rms_relative > result.quality.overall.rms_relative  # mostly Mitsuba's noise
    assert worst(bare.materials[0]) > 10


def test_its_rule_leaves_it_out(scene, tmp_path):
    result = fitted(scene, tmp_path, "viewer")
    (decision,) = (each for each in result.effects if each.name == NAME)
    assert (decision.on, decision.why) == (False, "the viewer has no lens")
