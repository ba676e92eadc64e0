"""The plan of scenes whose effects are known, against everything that could be on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from fit_material.fitter.effects.effect_measurement import Measurement, Sample, possible
from fit_material.fitter.effects.one_bounce import returned_light
from fit_material.fitter.effects.plan import Change
from fit_material.fitter.effects.planner import TOLERANCE, Planner
from fit_material.fitter.forward.lighting import Lighting, lighting_for
from fit_material.fitter.observations.scene_data import kinds_of, load
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.mitsuba.conversion import variant_here
from fit_material.renderer.path_tracing.differentiable_scene import require_variant
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.pixel_footprint import middle
from fit_material.shaders.effects import EFFECTS
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.renderer.rays.test_occlusion import CAMERA, inside, tensor
from tests.support import bowl as golden
from tests.support.plan_scenes import SCENES

AGAIN = 1  # seed
ROUNDING = 1e-6


@pytest.fixture(scope="module")
def planner_of(tmp_path_factory):
    @cache
    def made(name: str) -> Planner:
        scene = SCENES[name].write(tmp_path_factory.mktemp("scene"))
        loaded, options = load(scene), FitOptions(PRESETS[SCENES[name].fidelity])
        return Planner(
            loaded, gbuffer.tracer(loaded.shape), lighting_for(loaded, options, torch.device("cpu")), options
        )

    return made


@pytest.mark.parametrize("name", SCENES)
def test_the_plan_is_the_set_that_the_scene_was_built_for(name, planner_of):
    if "interreflection" in SCENES[name].expected:
        try:
            require_variant()
        except InputError as error:
            pytest.skip(str(error))
    planner = planner_of(name)
    assert planner.plan(kinds_of(planner.loaded, planner.options)).on == SCENES[name].expected


@pytest.mark.parametrize(("alpha", "blurred"), [(0.001, False), (0.05, True)])
def test_a_metal_that_is_found_to_be_a_mirror_calls_for_no_blur(alpha, blurred, planner_of):
    """A lobe of 0.001 spreads over 0.2°, a texel of the light over 6°, between which light is a plane."""
    mirror = Metal(tensor(golden.N), tensor(golden.K), Microfacet(tensor(alpha)))
    plan = planner_of("a lonely ball of metal").plan(["metal"], {"default": mirror})
    assert plan["blur"].on == blurred


@pytest.mark.parametrize(
    "name",
    ["a glossy ball with a lamp", "a bowl of metal", "two balls of metal, far apart", "a matte ring with a lamp"],
)
def test_what_was_bounded_on_a_sample_holds_for_other_pixels(name, planner_of):
    """Everything on, and all but one, of other pixels: a reason's bound is right in 95 of 100 samples.

    In as many new pixels twice the share that is bounded is not exceeded by chance. Of what is off this is what turning
    it on would change: no more than the tolerance.
    """
    planner = planner_of(name)
    kinds = kinds_of(planner.loaded, planner.options)
    plan, materials = planner.plan(kinds), possible([kind for kind in kinds if kind is not None])
    other = Sample.of(planner.loaded.photographs, planner.trace, 4, AGAIN)
    everything = replace(planner.lighting, occluder=planner.occluder, effects=frozenset(EFFECTS))
    again = Measurement(other, everything, materials, TOLERANCE)
    decisions = [each for each in plan.decisions if each.most is not None]
    assert decisions
    for each in decisions:
        changes = [again.moved(each.name, material) for material in materials if again.shows(each.name, material)]
        most = each.most if each.on else max(each.most or 0, TOLERANCE)
        beyond = (torch.stack(changes).amax(0) > most + ROUNDING).double().mean()
        assert beyond <= 2 * Change(0, 0, "", len(other.surface.hit)).beyond, each.name


def test_the_light_said_to_come_from_the_bowl_itself_is_what_mitsubas_paths_bring():
    """Paths of eight segments less those of two. One bounce in the viewer's blur stands for all of it: to a third."""
    surface, whole = inside()
    metal = Metal(tensor(golden.N), tensor(golden.K), Microfacet(tensor(golden.ALPHA)))
    bsdf = conductor(golden.N, golden.K, golden.ALPHA)
    deep, direct = (
        render(golden.bowl(), CAMERA, golden.light(), bsdf, spp=1024, max_depth=depth, variant=variant_here())
        for depth in (8, 2)
    )
    brought = (deep - direct)[whole, :3].astype(float).mean(0)
    lighting = Lighting(golden.light(), (), PRESETS["standard"])
    found = returned_light(gbuffer.tracer(golden.bowl()), middle(surface)[:, 0], lighting, metal).mean(0).numpy()
    np.testing.assert_allclose(found, brought, rtol=0.35)
