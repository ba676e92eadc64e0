"""A type of light that the program does not have, defined here alone: a bulb, which has a position.

Scene file, Mitsuba's photographs, our pictures and a fit take it as they take lights of their own. It has a name that
no type of the program will have.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.direct_light import DirectLight
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.validation import Vector
from fit_material.renderer.geometry.mesh import Shape, Sphere
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.bsdf import Bsdf, conductor, diffuse
from fit_material.renderer.materials.ground_truth import TrueMatte
from fit_material.renderer.mitsuba.conversion import EMITTERS, Emitter, variant_here
from fit_material.renderer.opengl.uploads import light_uniforms
from fit_material.renderer.path_tracing.path_tracer import passes
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder, occluder
from fit_material.renderer.scene.lights import LIGHTS, LightKind, LightSpec, Powers, light_of
from fit_material.renderer.scene.scene_file import read_scene
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from fit_material.renderer.viewer_model.viewer_light import surroundings
from fit_material.shaders.lights import DirectionalLight, Incident, Light
from fit_material.shaders.materials.types import Material, Matte, Metal
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.shade import EnvironmentLight, Points, reflection, scattered
from tests.support.bowl import ALPHA, K, N, bowl, looks
from tests.support.registries import added

pytestmark = pytest.mark.dr_jit

BULB, INTENSITY = (1.2, 1.4, 1.3), (6.0, 4.0, 3.0)  # W/sr; 2.3 from the ball's centre, 1.3 from its surface
CLAY = (0.5, 0.3, 0.2)
DIM = 0.01  # radiance of the surroundings
SIZE, PASSES, SPP = 16, 32, 64  # of 8 passes alone, 0.5 % of pixels lie beyond four of their own standard errors


@dataclass(frozen=True)
class Bulb(Light):
    """A light that shines evenly from one point: irradiance I/d² on a surface that faces it."""

    kind: ClassVar[str] = "bulb"

    position: Float[Tensor, "3"]
    intensity: Float[Tensor, "3"]

    def at(self, position: Float[Tensor, "*p 3"]) -> Incident:
        apart = self.position.to(position) - position
        distance = apart.norm(dim=-1)
        each = distance[..., None]
        return Incident(apart / each, self.intensity.to(position) / (math.pi * each**2), distance)


class BulbSpec(LightSpec):
    """`type = "bulb"`."""

    position: Vector
    intensity: Powers


def bulb(spec: BulbSpec) -> Bulb:
    return Bulb(vector(spec.position), vector(spec.intensity))


def emitter(light: Bulb) -> dict[str, object]:
    intensity = {"type": "rgb", "value": light.intensity.tolist()}
    return {"type": "point", "position": light.position.tolist(), "intensity": intensity}


def vector(values: tuple[float, ...]) -> Float[Tensor, " c"]:
    return torch.tensor(values, dtype=torch.float64)


@pytest.fixture(scope="module", autouse=True)
def known() -> Iterator[None]:
    """The program with bulbs."""
    with added(LIGHTS, LightKind("bulb", BulbSpec, bulb)), added(EMITTERS, Emitter("bulb", emitter)):
        yield


SPEC = BulbSpec(type="bulb", position=BULB, intensity=INTENSITY)
LAMP = Bulb(vector(BULB), vector(INTENSITY))


MATTE = Matte(vector(CLAY), vector((1.0, 1.0, 1.0)))
METAL = Metal(vector(N), vector(K), Microfacet(torch.tensor(ALPHA, dtype=torch.float64)))


def as_if_far(light: Bulb) -> DirectionalLight:
    """The directional light that does the same at the origin."""
    towards, radiance, _ = light.at(torch.zeros(3, dtype=torch.float64))
    return DirectionalLight(towards, radiance)


@cache
def dim() -> Environment:
    return Environment(torch.full((4, 8, 3), DIM))


def seen(shape: Shape, camera: Camera) -> tuple[GBuffer, np.ndarray]:
    """Pixels that the shape's front covers wholly, 6 × 6 rays in each: their rays, and which they are."""
    row, column = (torch.as_tensor(grid.ravel()) for grid in np.mgrid[:SIZE, :SIZE])
    surface = gbuffer.pixel_footprints(gbuffer.tracer(shape), camera, column, row, 6)
    whole = surface.front.all(-1)
    return surface[whole], whole.reshape(SIZE, SIZE).numpy()


def ours(
    shape: Shape, camera: Camera, material: Material, lights: tuple[Light, ...], hides: Occluder | None = None
) -> np.ndarray:
    """Radiance, [p, 3]."""
    lighting = Lighting(dim(), lights, PRESETS["standard"], occluder=hides)
    return lighting.radiance(material, seen(shape, camera)[0], 64).numpy()


def of_mitsuba(shape: Shape, camera: Camera, bsdf: Bsdf, lights: tuple[Light, ...]) -> np.ndarray:
    """Independent pictures by direct light alone, [pass, p, 3]."""
    _, whole = seen(shape, camera)
    options = {"lights": lights, "seed": 5, "max_depth": 2, "variant": variant_here()}
    pictures = passes(shape, camera, dim(), bsdf, [SPP] * PASSES, **options)
    return np.stack([picture[whole, :3].astype(float) for picture in pictures])


def excess(found: np.ndarray, expected: np.ndarray, model: float) -> float:
    """The 99th percentile of the pixels' differences over four standard errors and a share of the mean radiance."""
    error = expected.std(0, ddof=1) / math.sqrt(len(expected))
    return float(np.quantile(np.abs(found - expected.mean(0)) / (4 * error + model * expected.mean()), 0.99))


@pytest.mark.parametrize(
    ("material", "bsdf"), [(MATTE, diffuse(CLAY)), (METAL, conductor(N, K, ALPHA))], ids=["matte", "metal"]
)
def test_a_ball_by_a_bulb_is_mitsubas(material, bsdf):
    """36 rays of a pixel, and 64 directions of the dim surroundings, are their means to 3e-3 of the light."""
    ball, camera = Sphere(), views(1, Sphere(), 35.0)[0].camera(SIZE)
    expected = of_mitsuba(ball, camera, bsdf, (LAMP,))
    near, far = (excess(ours(ball, camera, material, (each,)), expected, 3e-3) for each in (LAMP, as_if_far(LAMP)))
    assert near < 1
    assert far > 10


@dataclass(frozen=True)
class EndlessRays(Bulb):
    """Whose shadow rays go on beyond it."""

    def at(self, position: Float[Tensor, "*p 3"]) -> Incident:
        found = super().at(position)
        return found._replace(distance=torch.full_like(found.distance, math.inf))


def test_shadow_rays_end_at_the_bulb():
    """One hangs inside of a bowl, whose far side is behind it; of the other the rim's shadow is in the bowl.

    36 rays of a pixel find the shadow's edge to a sixth of a pixel, 2 % of all light.
    """
    camera, body = looks()[0].camera(SIZE), bowl()
    inside = Bulb(vector((0.1, -0.65, 0.05)), vector((0.3, 0.3, 0.3)))
    outside = Bulb(vector((2.0, 0.3, 0.4)), vector(INTENSITY))
    expected, hides = of_mitsuba(body, camera, diffuse(CLAY), (inside, outside)), occluder(body)
    found = ours(body, camera, MATTE, (inside, outside), hides)
    assert excess(found, expected, 0.02) < 1
    endless = EndlessRays(inside.position, inside.intensity)
    assert excess(ours(body, camera, MATTE, (endless, outside), hides), expected, 0.02) > 2
    assert excess(ours(body, camera, MATTE, (inside, outside)), expected, 0.02) > 2


def test_each_ray_of_a_pixel_receives_its_own_irradiance():
    """I cos θ / (π d²), its mean by numpy, of a light so near that rays of one pixel differ by half."""
    surface, _ = seen(Sphere(), views(1, Sphere(), 35.0)[0].camera(SIZE))
    light = Bulb(vector((0.3, 0.4, 1.05)), vector(INTENSITY))
    apart = light.position.numpy() - surface.position.numpy()
    squared = (apart**2).sum(-1)
    cosine = (apart * surface.normal.numpy()).sum(-1).clip(0) / np.sqrt(squared)
    expected = (cosine / squared / math.pi).mean(1)[:, None] * np.array(INTENSITY)
    direct = DirectLight.of(surface, light)
    np.testing.assert_allclose(direct.received(), expected, rtol=1e-12)
    assert float(direct.falloff.min()) < 0.5


def test_the_viewers_model_asks_for_the_light_at_each_point():
    """E max(0, n·l) of a white body; F · E · G(|r - l|; ρ/2) of a surface that mirrors [MODEL.md 3.2, 4]."""
    normal = torch.nn.functional.normalize(vector((0.2, 0.5, 1.0)), dim=0).expand(2, 3)
    view, rho = vector((0.0, 0.0, 1.0)).expand(2, 3), vector((0.6,))[0]
    position = torch.stack([vector((0.0, 0.0, 1.0)), vector((0.5, 0.9, 0.1))])
    dark = EnvironmentLight(torch.zeros_like, torch.zeros(9, 3, dtype=torch.float64), sources=(LAMP,))
    points = Points(normal, view, position=position)
    mirrored = 2 * (normal * view).sum(-1, keepdim=True) * normal - view
    for i in range(2):
        apart = np.array(BULB) - position[i].numpy()
        length = np.linalg.norm(apart)
        irradiance, towards = np.array(INTENSITY) / (math.pi * length**2), apart / length
        body = irradiance * max(0.0, towards @ normal[i].numpy())
        np.testing.assert_allclose(scattered(points, dark)[i], body, rtol=1e-12)
        off, sigma = np.linalg.norm(mirrored[i].numpy() - towards), 0.3
        gaussian = math.exp(-(off**2) / (2 * sigma**2)) / (math.sqrt(2 * math.pi) * sigma)
        np.testing.assert_allclose(reflection(torch.ones_like(view), rho, points, dark)[i], irradiance * gaussian)
    assert scattered(replace(points, position=None), dark).isnan().all()


@pytest.fixture(scope="module")
def photographs(tmp_path_factory) -> Path:
    """The scene file of Mitsuba's photographs of a ball of clay by a bulb."""
    folder = tmp_path_factory.mktemp("bulb")
    write_exr(folder / "dim.exr", dim().radiance.numpy())
    options = SynthOptions(TrueMatte(CLAY), env=str(folder / "dim.exr"), lights=(SPEC,), size=32, spp=256, views=2)
    return synthesise(options, folder / "scene")


def test_a_scene_file_has_the_light(photographs):
    (spec,) = read_scene(photographs).lights
    assert spec == SPEC
    light = light_of(spec)
    assert isinstance(light, Bulb)
    assert (*light.position.tolist(), *light.intensity.tolist()) == (*BULB, *INTENSITY)


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        ('"bulb"', '"glow-worm"', r"lights\[0\]\.type: is \"glow-worm\", expected 'directional'.* or 'bulb'"),
        (
            "position",
            "place",
            r"lights\[0\]\.place: is \[1.2, 1.4, 1.3\], expected one of the keys type, position, int",
        ),
        ("[6.0,", "[-6.0,", r"lights\[0\]\.intensity\[0\]: is -6.0, expected greater than or equal to 0"),
    ],
)
def test_a_slip_in_its_table_is_told_as_any_other(photographs, before, after, sentence):
    slip = photographs.with_name("slip.toml")
    slip.write_text(photographs.read_text().replace(before, after))
    with pytest.raises(InputError, match=sentence):
        read_scene(slip)


def test_a_fit_recovers_the_colour_within_its_error(photographs, tmp_path):
    """And not where the bulb is taken to be far away."""
    options = FitOptions(PRESETS["preview"], type="matte")
    (found,) = fit_scene(photographs, tmp_path / "near", options).materials
    assert found.stderr.color is not None
    error = np.array(found.stderr.color)
    assert (error < 0.01).all()
    assert (np.abs(np.array(found.color) - CLAY) < 3 * error).all()
    far = as_if_far(LAMP)
    table = {"direction": far.towards.tolist(), "irradiance": (math.pi * far.radiance).tolist()}
    text = photographs.read_text().split("[[photographs]]")
    head = text[0].split("[[lights]]")[0] + '[[lights]]\ntype = "directional"\n'
    head += "".join(f"{key} = {json.dumps(value)}\n" for key, value in table.items())
    photographs.with_name("far.toml").write_text("[[photographs]]".join([head, *text[1:]]))
    (wrong,) = fit_scene(photographs.with_name("far.toml"), tmp_path / "far", options).materials
    assert (np.abs(np.array(wrong.color) - CLAY) > 10 * error).all()


def test_the_viewer_refuses_to_draw_it():
    expected = r'\[\[lights\]\]: type: is "bulb", expected "directional": the viewer draws no other lights'
    with pytest.raises(InputError, match=expected):
        light_uniforms(surroundings(dim(), (SPEC,), size=4))
