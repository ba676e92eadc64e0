"""How effects are decided: by structure, by measurement against the one tolerance, by word of the user."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.commands import app
from fit_material.fitter.commands.plan import json_text, text
from fit_material.fitter.effects.plan import Change, Plan, planned, require_choosable
from fit_material.fitter.effects.plan_rules import Facts
from fit_material.renderer.errors.input_error import InputError
from fit_material.shaders.effects import EFFECTS

METAL, MATTE = frozenset({"metal"}), frozenset({"matte"})
EVERY = frozenset({"metal", "glossy", "matte"})
OPEN = Facts(EVERY, 2, convex=False, blurs=False, reflectance="conductor", footprint=4)
TOLERANCE = 0.01
MEASURED = {"light-reflection", "ambient-occlusion", "self-visibility", "interreflection", "pixel-footprint"}


def moving(most: float):
    """A measurement in which each effect moves a pixel by that much."""
    return lambda names: {name: Change(most, 0.14, "gold", 256) for name in names}


def plan(facts: Facts = OPEN, most: float = 0.31, tolerance: float = TOLERANCE) -> Plan:
    return planned(facts, moving(most), tolerance)


@given(most=st.floats(0, 1), tolerance=st.floats(1e-6, 1))
def test_an_effect_is_on_where_it_moves_a_pixel_by_more_than_the_tolerance(most, tolerance):
    made = plan(most=most, tolerance=tolerance)
    assert all(made[name].on == (most > tolerance) for name in MEASURED)


def test_only_what_structure_leaves_open_is_measured():
    asked = []
    lonely = Facts(frozenset({"metal"}), 0, True, False, "conductor", 4)
    planned(lonely, lambda names: asked.extend(names) or moving(0.5)(names), TOLERANCE)
    assert asked == ["pixel-footprint"]


@pytest.mark.parametrize(
    ("changed", "name", "why"),
    [
        ({"kinds": MATTE}, "reflection", "the materials may be matte, which mirrors nothing"),
        (
            {"kinds": frozenset({"metal"})},
            "diffuse-irradiance",
            "the materials may be metal, which has no diffuse body",
        ),
        ({"lights": 0}, "light-reflection", "the scene has no directional lights"),
        ({"convex": True}, "self-visibility", "the object is convex, no point of it sees another"),
        ({"convex": True}, "ambient-occlusion", "the object is convex, no point of it sees another"),
        ({"blurs": True}, "self-visibility", "the viewer sees far surroundings alone"),
        ({"reflectance": "schlick"}, "exact-fresnel", "schlick's reflectance was requested"),
        ({"footprint": 1}, "pixel-footprint", "one ray per pixel was requested"),
    ],
)
def test_structure_rules_an_effect_out_whatever_its_size(changed, name, why):
    made = plan(replace(OPEN, **changed))[name] if "reflectance" not in changed else plan(_matteless(changed))[name]
    assert (made.on, made.why) == (False, why)


def _matteless(changed: dict) -> Facts:
    """Glossy things alone: the exact equations of metals are not for measurement to rule out."""
    return replace(OPEN, kinds=frozenset({"glossy"}), **changed)


def test_what_cannot_be_traced_is_told_and_its_pixels_avoided():
    made = plan(replace(OPEN, untraced="paths take LLVM"))
    assert not made["interreflection"].on
    assert made["interreflection"].why.endswith(
        "; but paths take LLVM: pixels that mirror the object are left out instead"
    )
    assert made.avoids
    assert not plan().avoids
    assert not plan(most=0.001).avoids
    assert not plan().overruled((), ("interreflection",)).avoids


def test_a_reason_holds_its_number_its_bound_and_its_confidence():
    assert plan()["light-reflection"].why == (
        "it moves 14.0% of 256 pixels by more than 0.01 of their light, up to 0.31 of it (gold);"
        " with 95 % confidence fewer than 1.2% of all move further"
    )


@given(st.integers(1, 10_000))
def test_the_bound_is_wilkss(pixels):
    """Where the share p of all pixels is beyond, none of n is in the sample with a chance of (1 - p)ⁿ = 5 %."""
    assert (1 - Change(0, 0, "", pixels).beyond) ** pixels == pytest.approx(0.05, rel=1e-6)


@given(on=st.sets(st.sampled_from(sorted(EFFECTS))), off=st.sets(st.sampled_from(sorted(EFFECTS))))
def test_a_word_of_the_user_overrules_and_says_so(on, off):
    before, off = plan(most=0.001), off - on
    after = before.overruled(tuple(on), tuple(off))
    assert after.on == (before.on | on) - off
    for decision in after.decisions:
        changed = decision.on != before[decision.name].on
        assert decision.overruled == changed
        assert decision.why.startswith(("--with overrules: ", "--without overrules: ")) == changed


def test_what_came_and_went_is_told_in_the_lists_order():
    one, other = plan(most=0.5), plan(replace(OPEN, kinds=frozenset({"matte"})), most=0.001)
    came, went = one.changed(other)
    assert set(came) == one.on - other.on
    assert not went
    assert came == [name for name in EFFECTS if name in came]


def test_cost_is_the_share_of_an_effects_time_beside_what_is_on():
    made = plan(replace(OPEN, kinds=frozenset({"metal"}), convex=True, lights=0))
    times = {name: effect.cost for name, effect in EFFECTS.items()}
    whole = sum(times[name] for name in made.on)
    assert made.cost("blur") == pytest.approx(times["blur"] / whole)
    assert made.cost("interreflection") == pytest.approx(times["interreflection"] / (whole + times["interreflection"]))
    assert made.cost("horizon") == 0


@pytest.mark.parametrize(
    ("on", "off", "sentence"),
    [
        (("nonsense",), (), "--with: is nonsense, expected an effect: reflection, blur,"),
        ((), ("nonsense",), "--without: is nonsense, expected an effect: reflection, blur,"),
        (("blur",), ("blur",), "--with: is blur, expected no effect that --without names as well"),
        (("normal-map",), (), "--with: is normal-map, expected another effect: this one takes a map"),
        ((), ("reflection",), "--without: is reflection, expected another effect: say --type matte instead"),
    ],
)
def test_what_cannot_be_chosen_is_refused(on, off, sentence):
    with pytest.raises(InputError) as told:
        require_choosable(on, off)
    assert str(told.value).startswith(sentence)


def test_json_is_the_contracts():
    effects = json.loads(json_text(plan()))["effects"]
    assert [effect["name"] for effect in effects] == list(EFFECTS)
    assert all(set(effect) == {"name", "on", "why", "share", "cost"} for effect in effects)
    assert {effect["name"]: effect["share"] for effect in effects}["self-visibility"] == 0.31


def test_a_line_for_each_effect():
    lines = text(plan()).splitlines()
    assert [line.split()[0] for line in lines[1:-1]] == list(EFFECTS)
    assert lines[-1] == "An effect is called for where it moves a pixel by more than 0.01 of its light."


def test_the_command_prints_and_writes_nothing(gold_scene, capfd, monkeypatch):
    before = sorted(gold_scene.parent.iterdir())
    monkeypatch.setattr(sys, "argv", ["fit-material", "plan", str(gold_scene), "--type", "metal", "--json"])
    with pytest.raises(SystemExit) as ended:
        app.main()
    effects = json.loads(capfd.readouterr().out)["effects"]
    assert ended.value.code == 0
    on = {effect["name"] for effect in effects if effect["on"]}
    assert on == {"reflection", "blur", "horizon", "exact-fresnel", "pixel-footprint"}
    assert sorted(gold_scene.parent.iterdir()) == before


def test_a_camera_that_sees_nothing_is_refused(gold_scene, capfd, monkeypatch):
    gold_scene.write_text(gold_scene.read_text().replace("target = [0.0, 0.0, 0.0]", "target = [99.0, 0.0, 0.0]"))
    monkeypatch.setattr(sys, "argv", ["fit-material", "plan", str(gold_scene)])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == 2
    sentence = "photographs: expected a camera that sees the object's front in the pixels its photograph shows\n"
    assert capfd.readouterr().err.endswith(sentence)
