"""Diffuse light between parts of an object: against closed forms, and colour maps of Mitsuba's photographs of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import torch

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.surface_samples import Places
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.result.schema import read_result
from fit_material.fitter.textures.radiosity import Looking, Radiosity, Transfer, radiosity
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.images.textures import read_texture
from fit_material.renderer.light_tables.irradiance_table import even_table
from fit_material.renderer.materials.bsdf import diffuse, plastic
from fit_material.renderer.mitsuba.conversion import mitsuba
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.shaders.lights import DirectionalLight
from fit_material.shaders.materials.types import Glossy, Matte, Metal
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.optics import fresnel
from tests.support import bowl as golden
from tests.support.textured import pattern, photograph_textured, ring, seen_at

CAP = (1 + math.cos(golden.RIM)) / 2  # share of the whole sphere that the bowl is
EVEN = Environment(torch.ones(16, 32, 3))


def inside(size: int = 48) -> GBuffer:
    """Pixels' centres on the inner side of the bowl, all of them."""
    surface = gbuffer.pixel_centres(gbuffer.tracer(golden.bowl()), golden.looks()[0].camera(size)).reshape(-1)
    return surface[surface.front]


def in_bowl(environment: Environment = EVEN, lamps: tuple[DirectionalLight, ...] = ()) -> Radiosity:
    lighting = Lighting(environment, lamps, PRESETS["preview"], occluder=Occluder.of(golden.bowl()))
    return radiosity(lighting, inside(), gbuffer.tracer(golden.bowl()), returning=True)


def even(value: float):
    """The same albedo everywhere."""
    return lambda met: np.full((len(met.material), 3), value)


@pytest.mark.parametrize("sent", [*(pytest.param(share, marks=pytest.mark.slow) for share in (0.0, 0.5, 1.0)), 0.9])
def test_an_evenly_lit_bowl_has_the_light_of_a_part_of_an_integrating_sphere(sent):
    # Every point of a sphere sees every other one under the same factor, so that light in a cap of the share c of it
    # is even: E = (1 - c) + ρ c E. The polyhedron is smaller by (2π/32)²/24 = 0.2 %, and 768 blocks of the sky show its
    # rim to 2 % at each place, to 0.1 % in the mean of some thousand. 256 rays know c to (c (1-c)/256)^½ = 0.03 at
    # each, of which ρ E is added, and to 0.1 % in the mean.
    found = in_bowl()
    assert len(found.places.surface.hit) > 1000
    np.testing.assert_allclose(found.light().share.mean(0), 1 - CAP, rtol=0.01)
    assert not found.light().returned.any()
    light = found.light(even(sent))
    np.testing.assert_allclose(light.total.mean(0), (1 - CAP) / (1 - sent * CAP), rtol=0.01)
    assert light.total.std() / light.total.mean() < 0.04
    np.testing.assert_allclose(light.total, light.share * found.unoccluded + light.returned, atol=1e-12)


@pytest.mark.parametrize("sky", [0.0, pytest.param(1.0, marks=pytest.mark.slow)])
def test_a_lamp_lights_the_bowl_by_way_of_its_walls(sky):
    # A lamp from above sends π L times the rim's disc, π sin², into the bowl; what is sent back of it falls evenly on
    # the whole sphere, 4π, and so does all that follows: E = ρ L sin²/4 / (1 - ρ c), over π. That the polyhedron's
    # places face the lamp otherwise than the sphere does is of second order, 0.5 %, as what the sky's light errs by.
    color = torch.tensor([0.9, 0.6, 0.3], dtype=torch.float64)
    lamp = DirectionalLight(torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64), color)
    sent, environment = 0.7, Environment(torch.full((16, 32, 3), sky))
    found = in_bowl(environment, (lamp,)).light(even(sent)).returned.mean(0)
    of_lamp = sent * color.numpy() * math.sin(golden.RIM) ** 2 / 4 / (1 - sent * CAP)
    of_sky = sky * (1 - CAP) * (1 / (1 - sent * CAP) - 1)
    np.testing.assert_allclose(found, of_lamp + of_sky, rtol=0.02)


def test_what_a_point_mirrors_of_the_object_is_as_bright_as_that_is():
    surface, found = inside(24), in_bowl()
    looking = Looking(gbuffer.tracer(golden.bowl()), Occluder.of(golden.bowl()), found.places)
    inwards = -surface.position  # every ray to the middle of the sphere and on meets its other side, or the sky
    towards = torch.nn.functional.normalize(inwards, dim=-1)[:, None]
    transfer = Transfer.of(surface, towards, torch.full((len(surface.hit), 1), 0.5, dtype=torch.float64), looking)
    light = found.light(even(0.5))
    arriving = transfer.arriving(light)
    opposite = -surface.position[:, 1].numpy()
    covered = opposite < math.cos(golden.RIM) - 0.05
    np.testing.assert_allclose(arriving[covered], 0.5 * 0.5 * light.total.mean(), rtol=0.1)
    assert not arriving[opposite > math.cos(golden.RIM) + 0.05].any()


def test_even_light_has_the_moments_of_chebyshevs_polynomials():
    cosine = (np.arange(100000) + 0.5) / 100000  # the midpoint rule errs by less than 11⁴/(12 · 100000^1.5)
    moments = [2 * np.mean(np.cos(b * np.arccos(2 * np.sqrt(cosine) - 1)) * cosine) for b in range(11)]
    np.testing.assert_allclose(even_table(11), moments, atol=5e-5)


def test_what_is_known_at_places_is_known_at_them_and_between():
    surface = inside(48)
    places = Places(surface[::2], extent=2.0)
    mixing = places.mixing(surface)
    np.testing.assert_allclose(np.asarray(mixing.sum(1)).ravel(), 1, atol=1e-12)
    # A place mixes its neighbours, about 1/20 away, by the square of `SAME` · 2 over that: 2e-5 each, of steps of 1/20.
    height = surface.position[:, 1].numpy()
    np.testing.assert_allclose((mixing @ height[::2])[::2], height[::2], atol=1e-5)
    np.testing.assert_allclose((mixing @ height[::2])[1::2], height[1::2], atol=0.1)  # nearest places lie that near


@pytest.mark.parametrize(("f0", "alpha", "color"), [(0.04, 0.1, 0.8), (0.04, 0.5, 0.3), (0.1, 0.2, 1), (0.02, 0.3, 0)])
def test_albedo_of_plastic_is_that_of_mitsuba(f0, alpha, color):
    material = Glossy(
        *(torch.full((3,), each, dtype=torch.float64) for each in (color, f0)), Microfacet(torch.tensor(alpha))
    )
    # Its table of T is 4e-4 too high, twice; weights scatter by 0.08 (by f0 without a body) over 20000 draws.
    np.testing.assert_allclose(material.albedo("ggx"), mitsuba_albedo(f0, alpha, color), atol=0.003)


def mitsuba_albedo(f0: float, alpha: float, color: float, draws: int = 20000) -> float:
    """Mean weight of sampled directions, over views by the cosine."""
    mi = mitsuba("scalar_rgb")
    bsdf = mi.load_dict(plastic((color,) * 3, f0, alpha))
    interaction, context, weights = mi.SurfaceInteraction3f(), mi.BSDFContext(), []
    for u, which, x, y in np.random.default_rng(0).random((draws, 4)):
        interaction.wi = mi.Vector3f(math.sqrt(1 - u), 0, math.sqrt(u))
        weights.append(bsdf.sample(context, interaction, which, mi.Point2f(x, y))[1][0])
    return float(np.mean(weights))


def test_albedo_of_matte_is_its_colour_at_every_place():
    colors = torch.rand(5, 3, dtype=torch.float64)
    torch.testing.assert_close(Matte(colors, torch.ones(3, dtype=torch.float64)).albedo("ggx"), colors)


def test_albedo_of_gold_is_about_its_mean_reflectance():
    n, k = (torch.tensor(each, dtype=torch.float64) for each in (golden.N, golden.K))
    metal = Metal(n, k, Microfacet(torch.tensor(0.01, dtype=torch.float64)))
    cosine = ((torch.arange(4096, dtype=torch.float64) + 0.5) / 4096)[:, None]
    mean = (2 * cosine * fresnel.conductor(cosine, n, k)).mean(0)
    # Schlick's curve is F0 + (1 - F0)/21 in the mean; a conductor's own dips before it rises
    assert bool(((mean - metal.albedo("ggx")).abs() < (1 - metal.f0) / 21 + 0.01).all())


@pytest.fixture(scope="module", params=["matte", "glossy"])
def bright_ring(request, tmp_path_factory) -> tuple[Path, str]:
    """Photographs of a bright torus under a pattern, by paths of eight segments."""
    folder = tmp_path_factory.mktemp(request.param)
    bsdf = diffuse((1.0, 1.0, 1.0)) if request.param == "matte" else plastic((1.0, 1.0, 1.0), 0.04, 0.3)
    mesh = ring(folder / "ring.obj")
    return photograph_textured(folder, mesh, bright(), bsdf, count=6, size=64, spp=256, max_depth=8), request.param


def bright() -> np.ndarray:
    return 0.45 + 0.5 * pattern(64)


def inner_errors(scene: Path, out: Path, options: FitOptions) -> np.ndarray:
    """Of the texels around the ring's inner equator that a photograph sees."""
    fit_scene(scene, out, options)
    maps = read_result(out / "result.json").materials[0].maps
    assert maps is not None
    color = read_texture(out / maps.color, color=True).texels.numpy()
    v = 1 - (np.arange(len(color)) + 0.5) / len(color)
    inner = (np.abs(v - 0.5) < 0.15)[:, None]
    return (color - seen_at(bright(), len(color)))[(iio.imread(out / maps.color_seen) >= 1) & inner]


@pytest.mark.slow  # photographs by long paths, two fits and their textures
def test_light_that_an_object_sends_itself_is_not_taken_for_its_colour(bright_ring, tmp_path):
    scene, kind = bright_ring
    options = FitOptions(PRESETS["preview"], type=kind, maps=("color",))
    counted = inner_errors(scene, tmp_path / "counted", options)
    left_out = inner_errors(scene, tmp_path / "left out", replace(options, unwanted=("interreflection",)))
    # 256 samples leave 5 % of noise in a pixel, 0.03 of the colour, and of some hundred texels seen by one pixel each
    # and smoothed a fifth of that in the mean, 0.006. What is left out makes colours of 0.6 brighter by 4 %.
    assert len(counted) > 100
    assert abs(counted.mean()) < 0.012
    assert left_out.mean() > 0.018
    sentence = "came from the object itself"
    assert sentence in read_result(tmp_path / "counted" / "result.json").message
    assert sentence not in read_result(tmp_path / "left out" / "result.json").message
