"""A fit by its plan: what is off is not computed, and the plan follows what was found."""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import replace

import pytest

from fit_material.fitter.effects import interreflection
from fit_material.fitter.effects.plan import Plan
from fit_material.fitter.effects.planner import Planner, spared
from fit_material.fitter.forward import direct_light, lighting
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline import describe_fit, planned_fit
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.pipeline.planned_fit import ROUNDS
from fit_material.fitter.result.schema import Result
from fit_material.renderer.path_tracing import differentiable_scene
from fit_material.renderer.rays import occlusion

FIDELITY = replace(PRESETS["preview"], pixels=300, search_pixels=300, samples=64, search_samples=32)
BALL = {"reflection", "blur", "horizon", "exact-fresnel", "pixel-footprint"}
LAMP = '\n[[lights]]\ntype = "directional"\ndirection = [0.3, 0.8, 0.5]\nirradiance = [1.0, 1.0, 1.0]\n'


@pytest.fixture
def calls(monkeypatch) -> Counter[str]:
    """How often the code of each effect runs in the fit itself; plan and report try effects on and off."""
    counted, fitting = Counter[str](), []

    def count(owner: object, name: str, effect: str) -> None:
        before = getattr(owner, name)

        def counting(*arguments, **options):
            counted[effect] += bool(fitting)
            return before(*arguments, **options)

        monkeypatch.setattr(owner, name, counting)

    def during(name: str) -> None:
        before = getattr(planned_fit, name)

        def fit(*arguments, **options):
            fitting.append(name)
            try:
                return before(*arguments, **options)
            finally:
                fitting.pop()

        monkeypatch.setattr(planned_fit, name, fit)

    during("fit_parts")
    during("polished_parts")
    count(lighting, "diffuse_table", "diffuse-irradiance")
    count(lighting, "mirror_table", "reflection without blur")
    count(lighting.light_table, "microfacet_table", "blur")
    count(direct_light.DirectLight, "of", "lights")
    count(direct_light.DirectLight, "reflected", "light-reflection")
    count(occlusion.Occluder, "origins", "rays")
    count(differentiable_scene.DifferentiableScene, "radiance", "interreflection")
    return counted


@pytest.fixture
def looked_for_paths(monkeypatch) -> list[object]:
    """How often a plan finds out whether Mitsuba can trace paths here, which loads it."""
    found: list[object] = []
    monkeypatch.setattr(interreflection, "require_polishable", found.append)
    return found


def fitted(scene, out, **options) -> Result:
    return fit_scene(scene, out, FitOptions(FIDELITY, **{"type": "metal", **options}))


def on(result: Result) -> set[str]:
    return {effect.name for effect in result.effects if effect.on}


def test_a_lonely_ball_of_metal_computes_its_lobe_and_nothing_else(gold_scene, tmp_path, calls, looked_for_paths):
    assert on(fitted(gold_scene, tmp_path / "out")) == BALL
    assert {effect for effect, count in calls.items() if count} == {"blur"}
    assert not looked_for_paths


def test_what_is_wanted_is_computed(gold_scene, tmp_path, calls):
    result = fitted(gold_scene, tmp_path / "out", wanted=("self-visibility",))
    assert on(result) == BALL | {"self-visibility"}
    assert calls["rays"]
    why = next(effect.why for effect in result.effects if effect.name == "self-visibility")
    assert why == "--with overrules: the object is convex, no point of it sees another"


def test_highlights_that_nobody_wants_are_not_computed(gold_scene, tmp_path, calls):
    with gold_scene.open("a") as file:
        file.write(LAMP)
    result = fitted(gold_scene, tmp_path / "out", unwanted=("light-reflection",))
    assert "light-reflection" not in on(result)
    assert calls["lights"]
    assert not calls["light-reflection"]


def test_without_blur_the_fit_looks_in_one_direction_per_ray(gold_scene, tmp_path, calls):
    fitted(gold_scene, tmp_path / "out", unwanted=("blur",))
    assert calls["reflection without blur"]
    assert not calls["blur"]


def test_what_was_found_drops_what_it_does_not_call_for(gold_scene, tmp_path):
    result = fitted(gold_scene, tmp_path / "out", type="auto")
    assert on(result) == BALL
    assert "diffuse-irradiance: not called for by what was found, and dropped." in result.message


def test_result_and_report_show_the_plan(gold_scene, tmp_path, monkeypatch):
    drawn, strips = [], describe_fit.strips
    monkeypatch.setattr(describe_fit, "strips", lambda *arguments: drawn.extend(strips(*arguments)) or drawn)
    fitted(gold_scene, tmp_path / "out")
    data = json.loads((tmp_path / "out" / "result.json").read_text())
    assert all(set(effect) == {"name", "on", "why"} for effect in data["effects"])
    shown = re.findall(r'alt="difference that (\S+) makes"', (tmp_path / "out" / "report.html").read_text())
    assert set(shown) == {strip.name for strip in drawn} == BALL - {"horizon"}
    assert all((strip.photograph[strip.mask] > 0).all() for strip in drawn)
    without = {strip.name: strip.fit[strip.mask] for strip in drawn}
    whole = drawn[0].photograph[drawn[0].mask]
    assert (without["reflection"] == 0).all()  # a metal is nothing else
    assert without["blur"].std() > 1.5 * whole.std()  # alpha 0.25 smooths the lamps of a studio
    assert 0 < abs(without["exact-fresnel"] / whole - 1).max() < 0.1  # of gold


GROWING = ("self-visibility", "ambient-occlusion", "light-reflection")


@pytest.mark.parametrize(("growth", "fits"), [(1, 2), pytest.param(3, 3, marks=pytest.mark.slow)])
def test_a_plan_that_grows_is_fitted_again_three_times_at_most(gold_scene, tmp_path, monkeypatch, growth, fits):
    """Each later plan has one more effect on, until it has so many; what no fit simulated is not said to be on."""
    monkeypatch.setattr("fit_material.fitter.pipeline.describe_fit.strips", lambda *arguments: [])
    plan, made, simulated = Planner.plan, [], []

    def growing(self: Planner, *arguments) -> Plan:
        made.append(len(made))
        return plan(self, *arguments).overruled(GROWING[: min(made[-1], growth)], ())

    fit = planned_fit.fit_parts

    def noted(loaded, trace, light, *arguments):
        simulated.append(light.effects & set(GROWING))
        return fit(loaded, trace, light, *arguments)

    monkeypatch.setattr(Planner, "plan", growing)
    monkeypatch.setattr(planned_fit, "fit_parts", noted)
    result = fitted(gold_scene, tmp_path / "out")
    assert simulated == [set(GROWING[:count]) for count in range(fits)]
    assert on(result) & set(GROWING) == simulated[-1]
    assert ("3 fits did not settle" in result.message) == (growth >= ROUNDS)


@pytest.mark.parametrize(("free", "why"), [(0.124, None), (0.125, "12.5% of the pixels mirror nothing"), (0.0, None)])
def test_paths_are_spared_where_one_pixel_in_eight_is_free(free, why):
    """Of a convex object, whose share counts as 0, other reasons speak."""
    told = spared(free)
    assert told is None if why is None else told.startswith(why)
