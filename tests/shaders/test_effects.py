"""The list of effects: its names are DESIGN.md's, and what it says of the code is so."""

from __future__ import annotations

import importlib
import re
from importlib import resources

import pytest

from fit_material.fitter.effects.plan import planned
from fit_material.fitter.effects.plan_rules import RULES, Facts
from fit_material.fitter.forward.pixel_effects import PIXEL_EFFECTS
from fit_material.shaders.effects import EFFECTS, Effect

CONTRACT = """
reflection blur horizon light-reflection diffuse-irradiance energy-guard normal-map color-map ambient-occlusion
double-bounce captured-neighbours depth-scaled-blur self-visibility interreflection exact-fresnel pixel-footprint
"""
NOTHING = Facts(frozenset({"matte"}), 0, True, False, "conductor", 1)
each = pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)


def test_the_names_are_the_contracts():
    assert [*EFFECTS] == CONTRACT.split()


@each
def test_an_effects_torch_code_is_there(effect: Effect):
    module, _, name = effect.torch.rpartition(".")
    assert callable(getattr(importlib.import_module(module), name))


@each
def test_an_effects_glsl_code_is_there_under_its_definition(effect: Effect):
    texts = {
        file.name: file.read_text("utf-8")
        for file in resources.files("fit_material.shaders.glsl").iterdir()
        if file.is_file()
    }
    if effect.glsl is not None:
        file, name = effect.glsl.split(": ")
        assert re.search(rf"^\w+ {name}\(", texts[file], re.MULTILINE)
    if effect.definition is not None:
        used = re.compile(rf"(#if(def)? .*{effect.definition}\b)|(defined\({effect.definition}\))")
        assert any(used.search(text) for text in texts.values())


@each
def test_an_effect_has_a_rule_and_words(effect: Effect):
    (decision,) = (one for one in planned(NOTHING, lambda names: {}, 0.01).decisions if one.name == effect.name)
    assert decision.why
    assert effect.adds
    assert effect.called_for
    assert effect.cost >= 0


def test_the_fit_has_rules_for_all_and_an_implementation_of_no_other():
    assert [*RULES] == [*EFFECTS]
    assert {*PIXEL_EFFECTS} <= {*EFFECTS}
