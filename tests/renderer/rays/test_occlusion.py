"""What an object hides from itself: light tables with rays, against closed forms and Mitsuba's direct light."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from fit_material.fitter.effects.plan_rules import RULES
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.light_kernel.llvm_integrator import LlvmIntegrator, fused_available
from fit_material.renderer.light_sampling.integrator import Integration, Integrator, LobeGrid
from fit_material.renderer.light_tables import light_table
from fit_material.renderer.light_tables.torch_integrator import TorchIntegrator
from fit_material.renderer.materials.bsdf import Bsdf, conductor, diffuse
from fit_material.renderer.mitsuba import raycast
from fit_material.renderer.mitsuba.conversion import mitsuba, variant_here
from fit_material.renderer.path_tracing.path_tracer import passes
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder, is_convex, occluder
from fit_material.shaders.effects import EFFECTS
from fit_material.shaders.lights import DirectionalLight
from fit_material.shaders.materials.types import Material, Matte, Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.renderer.rays.test_self_visibility import ball, balls
from tests.support import bowl as golden

pytestmark = pytest.mark.dr_jit

SIZE, PASSES, SPP = 12, 8, 512
ALL = frozenset(EFFECTS)
CAMERA = golden.looks()[0].camera(SIZE)
WHITE = (1.0, 1.0, 1.0)
LAMP = DirectionalLight(
    torch.nn.functional.normalize(torch.tensor([0.8, 0.7, 0.2], dtype=torch.float64), dim=0),
    torch.tensor([0.9, 0.6, 0.3], dtype=torch.float64),
)


def tensor(values: tuple[float, ...] | float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def inside() -> tuple[GBuffer, np.ndarray]:
    """Pixels that the bowl's inner side covers wholly, 6 × 6 rays in each: their rays, and which they are."""
    row, column = (torch.as_tensor(grid.ravel()) for grid in np.mgrid[:SIZE, :SIZE])
    surface = gbuffer.pixel_footprints(gbuffer.tracer(golden.bowl()), CAMERA, column, row, 6)
    whole = surface.front.all(-1)
    return surface[whole], whole.reshape(SIZE, SIZE).numpy()


def of_mitsuba(bsdf: Bsdf, lights: tuple[DirectionalLight, ...] = ()) -> np.ndarray:
    """Independent pictures [pass, p, 3] by direct light alone, which Mitsuba tests by shadow rays."""
    _, whole = inside()
    pictures = passes(
        golden.bowl(),
        CAMERA,
        golden.light(),
        bsdf,
        [SPP] * PASSES,
        lights=lights,
        seed=3,
        max_depth=2,
        variant=variant_here(),
    )
    return np.stack([picture[whole, :3].astype(float) for picture in pictures])


def ours(material: Material, lights: tuple[DirectionalLight, ...] = ()) -> np.ndarray:
    """Independent pictures [seed, p, 3] by tables."""
    surface, _ = inside()
    lighting = Lighting(golden.light(), lights, PRESETS["standard"], occluder=occluder(golden.bowl()))
    return np.stack([replace(lighting, seed=seed).radiance(material, surface, 512).numpy() for seed in range(4)])


def assert_alike(found: np.ndarray, expected: np.ndarray, model: float) -> None:
    """Of the same mean, pixel by pixel and over all, within four standard errors of either and a share for the model.

    One pixel in a thousand may be further off where noise is skewed.
    """
    off = np.abs(found.mean(0) - expected.mean(0))
    error = np.sqrt(found.var(0, ddof=1) / len(found) + expected.var(0, ddof=1) / len(expected))
    level = expected.mean(0).mean(0)
    assert np.quantile(off - 4 * error - 3 * model * level, 0.99) < 0
    of_all = np.abs(found.mean((0, 1)) - expected.mean((0, 1)))
    assert (of_all < 4 * error.mean(0) / math.sqrt(error.shape[0]) + model * level).all()


@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_a_table_with_rays_has_the_direct_light_of_mitsuba(alpha):
    """Without rays the bowl is several times as bright.

    The model's share: 36 traced rays of 72 tell where rays start, which moves the edge of what is hidden by a tenth of
    a pixel: 0.5 % of all light, thrice that in a pixel.
    """
    metal = Metal(tensor(golden.N), tensor(golden.K), Microfacet(tensor(alpha)))
    expected = of_mitsuba(conductor(golden.N, golden.K, alpha))
    assert_alike(ours(metal), expected, 0.005)
    surface, _ = inside()
    open_to_all = Lighting(golden.light(), (), PRESETS["standard"]).radiance(metal, surface, 512).numpy()
    assert open_to_all.mean() > 1.2 * expected.mean()


@pytest.mark.parametrize("effect", sorted(EFFECTS))
def test_a_light_table_differs_by_the_effects_that_are_said_to_change_it(effect):
    """Plans make one table for all others."""
    metal, surface = Metal(tensor(golden.N), tensor(golden.K), Microfacet(tensor(0.3))), inside()[0][:16]
    lighting = Lighting(golden.light(), (LAMP,), PRESETS["standard"], occluder=occluder(golden.bowl()))
    found, without = (lighting.simulating(effects).table_of(metal, surface, 64) for effects in (ALL, ALL - {effect}))
    same = found.light.shape == without.light.shape and torch.equal(found.light, without.light)
    assert same == (not RULES[effect].changes_table)


def test_a_diffuse_body_has_the_direct_light_of_mitsuba_lamp_included():
    """3072 blocks of the map each shine from one point: shadows of the largest, 4° wide, are as much off: 1 %."""
    matte = Matte(tensor(WHITE), tensor(WHITE))
    assert_alike(ours(matte, (LAMP,)), of_mitsuba(diffuse(WHITE), (LAMP,)), 0.01)


@pytest.mark.skipif(not fused_available(), reason="no LLVM")
def test_the_kernel_and_torch_agree():
    """Means over 80 pixels: one seed scatters by 0.45 % of all light, the difference of 3 and 3 by 0.37 %; thrice."""
    surface, _ = inside()
    hides = Occluder.of(golden.bowl())

    def mean(integrator: Integrator) -> torch.Tensor:
        made = [
            light_table.microfacet_table(
                surface,
                golden.light(),
                LobeGrid(0.2, 0.4, 2, "ggx"),
                Integration(degree=4, samples=1024, seed=seed),
                occluder=hides,
                integrator=integrator,
            )
            for seed in range(3)
        ]
        return torch.stack([table.mean(torch.float64).mean(1) for table in made]).mean(0)

    fused, plain = mean(LlvmIntegrator()), mean(TorchIntegrator())
    assert ((fused - plain).abs() < 0.011 * plain[:, :1]).all()


def test_openness_of_a_spherical_bowl_is_that_of_its_missing_cap():
    """From a sphere's inside each part of it lights in proportion to its area alone: so does the cap that is missing.

    Of 64 rays to a hundred points by one set of Sobol points, with facets of 7°: 2 %.
    """
    surface, _ = inside()
    found = Occluder.of(golden.bowl()).openness(surface[:, 0])
    cap = (1 - math.cos(golden.RIM)) / 2
    assert float(found.mean()) == pytest.approx(cap, abs=0.02)


@pytest.mark.parametrize("variant", ["llvm_ad_rgb", "scalar_rgb"])
def test_a_shadow_ray_ends_at_the_light(variant):
    """Between two unit balls whose centres are 2.5 apart: from the middle, along the axis, one is met after 0.25."""
    try:
        mi = mitsuba(variant)
    except InputError as error:
        pytest.skip(str(error))
    cast = {"llvm_ad_rgb": raycast._vectorised, "scalar_rgb": raycast._one_by_one}[variant](balls(), mi)
    between = replace(Occluder.of(balls()), cast=cast)
    origins, along = torch.zeros(5, 3, dtype=torch.float64), tensor((1.0, 0.0, 0.0))
    ends = tensor((0.2, 0.249, 0.251, 3.0, math.inf))
    assert between.free(origins, along, ends).tolist() == [True, True, False, False, False]
    assert between.free(origins, along).tolist() == [False] * 5
    assert between.free(origins, tensor((0.0, 1.0, 0.0)), ends).all()


@pytest.mark.parametrize(
    ("mesh", "convex"),
    [(ball(np.zeros(3), 3), True), (balls(), False), (golden.bowl(), False), (None, True)],
    ids=["ball", "two balls", "bowl", "seams"],
)
def test_only_what_is_closed_and_convex_is_convex(mesh, convex):
    if mesh is None:  # each face with corners of its own, as files with texture seams have them
        whole = ball(np.zeros(3), 2)
        apart = np.arange(3 * len(whole.faces)).reshape(-1, 3)
        mesh = replace(whole, vertices=whole.vertices[whole.faces].reshape(-1, 3), faces=apart, normals=None)
    assert is_convex(mesh) == convex
    assert (occluder(mesh) is None) == convex


def test_a_ball_seen_from_inside_is_not_convex():
    whole = ball(np.zeros(3), 2)
    assert not is_convex(replace(whole, faces=whole.faces[:, ::-1]))


def test_a_sphere_has_no_occluder():
    assert occluder(Sphere()) is None


def test_no_ray_is_cast_where_nothing_is_hidden(monkeypatch):
    """Counted, in torch, where each is a call: none without the effect, one per block of samples with it."""
    surface, _ = inside()
    calls = []
    hides = Occluder.of(golden.bowl())
    counted = replace(hides, cast=lambda *rays: (calls.append(len(rays[0])), hides.cast(*rays))[1], compiled=None)
    lighting = Lighting(golden.light(), (LAMP,), PRESETS["preview"], occluder=counted)
    metal = Metal(tensor(golden.N), tensor(golden.K), Microfacet(tensor(0.2)))
    without = lighting.simulating(lighting.effects - {"self-visibility", "ambient-occlusion"})
    without.radiance(metal, surface, 16)
    without.radiance(Matte(tensor(WHITE), tensor(WHITE)), surface, 16)
    assert not calls
    lighting.radiance(metal, surface, 16)
    assert sum(calls) == len(surface.hit) * (surface.hit.shape[1] + 2 * 16 // 2)
