"""Exposure and white balance by what is seen behind the object, against Mitsuba's pictures of the environment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import torch

from fit_material.fitter.estimation.background_calibration import Behind, Patch
from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.mitsuba.conversion import envmap, mitsuba, sensor
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.scene.scene_file import CameraSpec, PhotographSpec, camera_of
from fit_material.renderer.synthesis.studio import sun_and_sky
from fit_material.shaders.tone_mapping import srgb

SIZE = 64
CAMERA = CameraSpec(origin=(0.0, 0.3, 4.0), target=(0.0, 0.0, 0.0), fov=45.0)


@pytest.fixture(scope="module")
def light() -> Environment:
    return sun_and_sky()


@pytest.fixture(scope="module")
def surroundings(light) -> np.ndarray:
    """The environment through the camera, with a black ball before it."""
    mi = mitsuba("scalar_rgb")
    ball = {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": 0.0}}
    view = {"type": "scene", "integrator": {"type": "path"}, "light": envmap(light), "ball": ball}
    scene = mi.load_dict({**view, "sensor": sensor(camera_of(CAMERA, SIZE, SIZE))})
    return np.array(mi.render(scene, spp=32, seed=0))[..., :3]


def behind(spec: PhotographSpec, light: Environment) -> Behind | None:
    patch = Patch.of(spec, gbuffer.tracer(Sphere()))
    return None if patch is None else patch.against(latlong.of(light))


def told(folder: Path, pixels: np.ndarray, light: Environment) -> Behind | None:
    write_exr(folder / "view.exr", pixels.astype(np.float32))
    spec = PhotographSpec(image=folder / "view.exr", exposure="fit", camera=CAMERA)
    return behind(spec, light)


def test_factors_on_a_photograph_are_found_within_their_errors(surroundings, light, tmp_path):
    """Noise of 5 % a pixel, and a stand of two thirds of grey below the ball; the error is half a per cent at least."""
    noise = 1 + 0.05 * np.random.default_rng(3).normal(size=surroundings.shape)
    pixels = surroundings * noise * [0.2, 0.1, 0.05]
    pixels[54:, 26:38] = 0.01
    found = told(tmp_path, pixels, light)
    assert found is not None
    off = (found.ratio - torch.tensor([0.2, 0.1, 0.05]).double().log()).abs()
    assert (off < 3 * found.error).all()
    assert (found.error < 0.02).all()


def test_eight_bits_do_as_well(surroundings, light, tmp_path):
    """Clipped pixels are left out; rounding to codes is even."""
    full = np.quantile(surroundings, 0.9)
    codes = np.rint(255 * srgb(torch.from_numpy((surroundings / full).clip(0, 1))).numpy()).astype(np.uint8)
    iio.imwrite(tmp_path / "view.png", codes)
    spec = PhotographSpec(image=tmp_path / "view.png", exposure="fit", camera=CAMERA)
    found = behind(spec, light)
    assert found is not None
    assert (found.ratio + np.log(full)).abs().max() < 3 * float(found.error.max())


def test_a_cut_out_object_tells_nothing(surroundings, light, tmp_path):
    assert told(tmp_path, np.zeros_like(surroundings), light) is None


def test_a_room_that_is_not_the_maps_tells_nothing(surroundings, light, tmp_path):
    """The map turned by half a circle; a plain wall."""
    assert told(tmp_path, surroundings, replace(light, rotation=180.0)) is None
    assert told(tmp_path, np.full_like(surroundings, 0.3), light) is None


def test_an_object_that_fills_the_frame_tells_nothing(surroundings, light, tmp_path):
    write_exr(tmp_path / "near.exr", surroundings)
    near = CAMERA.model_copy(update={"origin": (0.0, 0.0, 1.5)})
    spec = PhotographSpec(image=tmp_path / "near.exr", exposure="fit", camera=near)
    assert behind(spec, light) is None
