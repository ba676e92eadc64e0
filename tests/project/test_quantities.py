"""Every schema, table, command and uniform that names quantities or types, against their one list."""

from __future__ import annotations

import dataclasses
import re
import typing

import pytest

from fit_material.fitter.command_line.choices import TypeName
from fit_material.fitter.commands.frontier import ErrorName
from fit_material.fitter.commands.synth import synth
from fit_material.fitter.frontier.errors import Reference
from fit_material.fitter.materials.registry import FITTABLE
from fit_material.fitter.result import formatting
from fit_material.fitter.result.schema import PerParameter
from fit_material.renderer.materials.catalogue import read_catalogue
from fit_material.renderer.materials.ground_truth import TRUE_TYPES
from fit_material.renderer.materials.material_file import TrueMaterialSpec
from fit_material.shaders.materials.kinds import KINDS
from fit_material.shaders.materials.quantities import ALPHA, F0, QUANTITIES, ROUGHNESS, K, N
from fit_material.shaders.materials.types import TYPES
from tests.support.paths import ROOT

STORED = QUANTITIES.keys() - {F0.name}


def test_results_have_every_quantity_and_no_other():
    assert list(PerParameter.model_fields) == list(QUANTITIES)
    for name, field in PerParameter.model_fields.items():
        triple = typing.get_origin(typing.get_args(field.annotation)[0]) is tuple
        assert QUANTITIES[name].channels == (3 if triple else 1)


def test_files_and_commands_that_describe_a_material_have_every_quantity_that_makes_one_up():
    kept = {"name", "type", "metal", "distribution"}
    assert TrueMaterialSpec.model_fields.keys() - kept == STORED
    assert synth.__annotations__.keys() >= STORED
    assert set(Reference.model_fields) - {"name", "type"} == QUANTITIES.keys() - {"reflectance"}
    assert {each.value for each in ErrorName} - {"worst", "picture"} < QUANTITIES.keys()


def test_every_layer_has_every_type():
    assert [each.value for each in TypeName] == ["auto", *KINDS]
    assert KINDS.keys() == TYPES.keys() == TRUE_TYPES.keys() == FITTABLE.keys()


@pytest.mark.parametrize("name", KINDS)
def test_every_layer_of_a_type_has_its_quantities(name):
    kind = KINDS[name]
    stored = [quantity.name for quantity in kind.stored]
    assert {each.name for each in kind.quantities} <= QUANTITIES.keys()
    assert [field.name for field in dataclasses.fields(TYPES[name])] == stored + ["width"] * kind.mirrors  # type: ignore[arg-type]
    assert [*stored, *[ALPHA.name, ROUGHNESS.name] * kind.mirrors] == [
        field.name
        for field in dataclasses.fields(TRUE_TYPES[name])
        if field.name in QUANTITIES  # type: ignore[arg-type]
    ]
    assert {*FITTABLE[name].essential, *FITTABLE[name].decisive} <= {*kind.quantities}
    assert kind.same_as.items() <= {(each.name, other.name) for each in kind.derived for other in kind.stored}


def test_words_for_people_have_every_quantity():
    assert sorted(formatting.PARAMETERS) == sorted(QUANTITIES)
    assert set(formatting.HEADLINE) < QUANTITIES.keys()
    symbols = (ROOT / "docs" / "model.md").read_text("utf-8")
    for quantity in QUANTITIES.values():
        assert re.search(rf"^\|.*`{quantity.name}`.*\|$", symbols, re.M)


def test_the_page_of_results_has_the_widths_that_count_as_determined():
    """Its table of number, relative, absolute; a dash is 0."""
    page = (ROOT / "docs" / "results.md").read_text("utf-8")
    table = page[page.index("| number | relative | absolute |") :]
    found = {}
    for names, relative, absolute in re.findall(r"^\| (`[^|]*`) \| (\S+)[^|]*\| (\S+) \|$", table, re.M):
        for name in re.findall(r"`(\w+)`", names):
            found[name] = (float(relative.replace("–", "0")) / 100, float(absolute.replace("–", "0")))
    assert found == {each.name: each.resolved for each in QUANTITIES.values()}


def test_uniforms_of_the_shader_are_the_numbers_of_the_thesis():
    """Those with a key in its MTL dialect; n of three channels is a vec3."""
    text = (ROOT / "shaders" / "glsl" / "shade.glsl").read_text("utf-8")
    uniforms = {
        name.strip(): kind
        for kind, names in re.findall(r"^uniform (vec3|float) ([\w, ]+);", text, re.M)
        for name in names.split(",")
    }
    of_material = {name: kind for name, kind in uniforms.items() if name in QUANTITIES}
    drawn = {each.name: {1: "float", 3: "vec3"}[each.channels] for each in QUANTITIES.values() if each.mtl is not None}
    assert of_material == drawn
    for kind in KINDS.values():
        assert f"defined({kind.name.upper()})" in text


def test_keys_of_the_thesis_are_each_some_quantity_of_a_type():
    """[thesis, table 3.2]: Kd and Ka of each type, Ks of those that mirror."""
    for kind in KINDS.values():
        keys = sorted(each.mtl for each in kind.quantities if each.mtl is not None)
        assert keys == ["Ka", "Kd"] + ["Ks"] * kind.mirrors


def test_known_metals_lie_in_the_domains():
    for metal in read_catalogue():
        for quantity, values in ((N, metal.n), (K, metal.k)):
            low, high = quantity.domain
            assert all(low <= value <= high for value in values)
