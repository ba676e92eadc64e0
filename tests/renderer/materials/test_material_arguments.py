"""What a user says of a material, as options or in a file, against what is made of it."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.commands import app
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueGlossy, TrueMatte, TrueMetal
from fit_material.renderer.materials.material_arguments import shading_model, true_material, with_default_alpha
from fit_material.renderer.materials.material_file import read_materials

RED, PALE = (0.6, 0.1, 0.05), (0.04, 0.04, 0.04)
SAID = {"metal": "Au", "n": RED, "k": PALE, "color": RED, "reflectance": PALE, "alpha": 0.3, "roughness": 0.4}
FILE = """
[[materials]]
name = "lid"
type = "metal"
metal = "gold"
alpha = 0.2
[[materials]]
name = "body"
type = "glossy"
color = [0.6, 0.1, 0.05]
reflectance = [0.04, 0.04, 0.04]
alpha = 0
distribution = "beckmann"
[[materials]]
name = "foot, of wood"
type = "matte"
color = [1, 0.1, 0.05]
"""


@pytest.fixture
def written(tmp_path):
    """Writes a file of materials."""

    def write(text: str) -> Path:
        path = tmp_path / "materials.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ({"metal": "GOLD"}, TrueMetal(metal("Au").n, metal("Au").k, metal="Au", source=metal("Au").source)),
        ({"n": RED, "k": PALE, "alpha": 0.1}, TrueMetal(RED, PALE, 0.1)),
        ({"color": RED}, TrueMatte(RED)),
        ({"color": RED, "reflectance": PALE, "roughness": 0.1}, TrueGlossy(RED, PALE, roughness=0.1)),
        ({"color": RED, "reflectance": PALE, "type": "matte"}, TrueMatte(RED, PALE)),
    ],
)
def test_the_type_follows_from_what_is_said(said, expected):
    assert true_material(**said) == expected


@given(
    keys=st.sets(st.sampled_from(sorted(SAID))),
    type_=st.sampled_from(["auto", "metal", "glossy", "matte"]),
    distribution=st.sampled_from(["ggx", "beckmann"]),
)
def test_whatever_is_said_is_kept_or_refused(keys, type_, distribution):
    said = {key: SAID[key] for key in keys}
    try:
        material = true_material(type_, **said, distribution=distribution)
    except InputError:
        return
    assert type_ in ("auto", material.type)
    for key in keys - {"metal"}:
        assert getattr(material, key) == said[key]
    if "metal" in keys:
        assert isinstance(material, TrueMetal)
        assert (material.n, material.k) == (metal("Au").n, metal("Au").k)


def test_alpha_is_made_up_only_where_mitsuba_needs_one():
    gold, matte = true_material(metal="Au"), TrueMatte(RED)
    assert with_default_alpha(gold, "mitsuba") == TrueMetal(
        metal("Au").n, metal("Au").k, 0.2, metal="Au", source=metal("Au").source
    )
    assert with_default_alpha(gold, "viewer") == gold
    assert with_default_alpha(matte, "mitsuba") == matte
    mirror = TrueMetal(RED, PALE, 0.0)
    assert with_default_alpha(mirror, "mitsuba") == mirror


def test_roughness_calls_for_the_viewer():
    rough, wide = TrueGlossy(RED, PALE, roughness=0.0), TrueGlossy(RED, PALE, 0.1)
    assert shading_model(None, TrueMatte(RED), rough) == "viewer"
    assert shading_model(None, TrueMatte(RED), wide) == "mitsuba"
    assert shading_model("viewer", TrueMatte(RED)) == "viewer"


def test_a_file_says_what_each_material_is(written):
    materials, model = read_materials(written(FILE))
    assert model == "mitsuba"
    assert materials == {
        "lid": TrueMetal(metal("Au").n, metal("Au").k, 0.2, metal="Au", source=metal("Au").source),
        "body": TrueGlossy(RED, PALE, 0.0, distribution="beckmann"),
        "foot, of wood": TrueMatte((1.0, 0.1, 0.05)),
    }


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('name = "body"', 'name = "lid"', 'materials[1].name: is "lid", expected a name that is not taken'),
        ('name = "body"', "", "materials[1].name: expected a value here, but it is missing"),
        ('name = "body"', 'nome = "body"', 'materials[1].nome: is "body", expected a known key, the nearest is name'),
        ('type = "glossy"', 'type = "shiny"', "materials[1].type: is \"shiny\", expected 'metal', 'glossy' or 'matte'"),
        ('metal = "gold"', 'metal = "unobtainium"', "materials[0].metal: is 'unobtainium', expected a known metal"),
        ('metal = "gold"', "", "materials[0].metal: is without a metal, expected either a metal's name, or n and k"),
        (
            'metal = "gold"',
            "color = [1, 1, 1]",
            "materials[0].color: is [1.0, 1.0, 1.0], expected no color for a metal",
        ),
        ("alpha = 0.2", "", "materials[0].alpha: expected a number here: a metal surface"),
        ("alpha = 0.2", "alpha = 2", "materials[0].alpha: is 2.0, expected at least 0.001"),
        ("alpha = 0.2", "alpha = nan", "materials[0].alpha: is nan, expected"),
        ("alpha = 0.2", 'alpha = "0.2"', 'materials[0].alpha: is "0.2", expected a number'),
        ("alpha = 0.2", "roughness = 0.2", "materials[1].alpha: is 0.0, expected --roughness"),
        ("[0.6, 0.1, 0.05]", "[0.6, 0.1]", "materials[1].color[2]: expected a value here"),
        ("[0.04, 0.04, 0.04]", "[0.04, 0.04, 0.05]", "materials[1].reflectance: is [0.04, 0.04, 0.05], expected three"),
        ("[[materials]]", "[materials]", "expected TOML"),
        (FILE, "", "materials: expected a value here, but it is missing"),
    ],
)
def test_what_is_wrong_in_a_file_is_said_in_one_sentence(old, new, sentence, written):
    path = written(FILE.replace(old, new))
    with pytest.raises(InputError, match=re.escape(sentence)) as error:
        read_materials(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_a_missing_file_is_said_to_be_missing(tmp_path):
    with pytest.raises(InputError, match=r"no\.toml: expected a readable file of materials here \(there is none\)"):
        read_materials(tmp_path / "no.toml")


def synth(monkeypatch, *arguments: object) -> None:
    """Run the command inside this process."""
    monkeypatch.setattr(sys, "argv", ["fit-material", "synth", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code in (0, 2)


SMALL = ("--size", 8, "--views", 1, "--spp", 1)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("--color 0.5 0.4 0.3", {"type": "matte", "color": [0.5, 0.4, 0.3], "reflectance": [1, 1, 1], "alpha": None}),
        (
            "--color 0.5 0.4 0.3 --reflectance 0.05 0.05 0.05 --alpha 0.1 --distribution beckmann",
            {"type": "glossy", "f0": [0.05] * 3, "alpha": 0.1, "distribution": "beckmann", "roughness": None},
        ),
        ("--metal Au", {"type": "metal", "alpha": 0.2, "metal": "Au"}),
        ("--metal Au --alpha 0", {"type": "metal", "alpha": 0}),
        ("--metal Au --roughness 0.3", {"type": "metal", "roughness": 0.3, "alpha": None, "held": None}),
        ("--color 0.5 0.4 0.3 --model viewer", {"type": "matte", "held": None}),
        ("--color 0.5 0.4 0.3 --light 1 2 3 4 5 6", {"type": "matte"}),
    ],
)
def test_the_command_makes_what_is_said(said, expected, tmp_path, monkeypatch, capfd):
    synth(monkeypatch, *said.split(), *SMALL, "-o", tmp_path)
    assert capfd.readouterr().out == f"{tmp_path / 'scene.toml'}\n"
    (material,) = json.loads((tmp_path / "truth.json").read_text())["materials"]
    assert {key: material[key] for key in expected} == expected


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ("--materials no.toml --color 1 1 1", "--color: is [1.0, 1.0, 1.0], expected no color beside --materials"),
        ("--materials no.toml", "no.toml: expected a readable file of materials"),
        ("--metal Au --light 0 0 0 1 1 1", "--light: direction: is"),
        ("--metal Au --light 0 1 0 1 -1 1", "--light: irradiance[1]: is -1.0"),
        ("--metal Au --model viewer", "--roughness: expected a number here"),
        ("--metal Au --roughness 0.1 --alpha 0.1", "--alpha: is 0.1, expected --roughness"),
        ("--color 1 1 2", "--color: is [1.0, 1.0, 2.0], expected three numbers from 0 to 1"),
    ],
)
def test_the_command_refuses_in_one_sentence(said, sentence, tmp_path, monkeypatch, capfd):
    synth(monkeypatch, *said.split(), *SMALL, "-o", tmp_path / "out")
    told = capfd.readouterr().err
    assert told.startswith(f"fit-material: {sentence}")
    assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_scene_of_three_materials_is_made(tmp_path, written, monkeypatch):
    names = ("lid", "body", "foot, of wood")
    corners = ("1 3 2", "1 2 4", "1 4 3")
    faces = "".join(f"usemtl {name}\nf {face}\n" for name, face in zip(names, corners, strict=True))
    mesh = tmp_path / "mesh.obj"
    mesh.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n{faces}")
    synth(monkeypatch, "--mesh", mesh, "--materials", written(FILE), *SMALL, "-o", tmp_path / "out")
    truth = json.loads((tmp_path / "out" / "truth.json").read_text())
    assert {entry["name"]: entry["type"] for entry in truth["materials"]} == dict(
        zip(names, ("metal", "glossy", "matte"), strict=True)
    )
