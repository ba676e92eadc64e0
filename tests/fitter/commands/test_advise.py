"""`fit-material advise` as a user meets it: what it prints, and every slip in one sentence."""

from __future__ import annotations

import json
import shutil
import sys
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.commands import app
from fit_material.fitter.options.fidelity import PRESETS, preset
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.scene.scene_file import read_scene
from tests.support.soft_scene import gold, soft_scene

VIEW = "origin target up fov projection scale ratio angle_to_nearest_view"
WHY = "the viewer's model sees F0 alone, and follows no photograph closely enough to choose another view"


@pytest.fixture(scope="module")
def fitted(tmp_path_factory) -> Path:
    """A small scene of gold, and its result in `out` beside it."""
    scene = soft_scene(tmp_path_factory.mktemp("scene"), gold(), views=2, size=32, spp=32)
    fit_scene(scene, scene.parent / "out", FitOptions(preset("preview"), type="metal"))
    return scene


@pytest.fixture
def scene(fitted, tmp_path) -> Path:
    """A copy, to spoil."""
    return Path(shutil.copytree(fitted.parent, tmp_path / "scene")) / "scene.toml"


@pytest.fixture
def call(capfd, monkeypatch):
    """Run the command inside this process: exit code, what it printed, and what it complained of."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["fit-material", "advise", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            app.main()
        printed = capfd.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, printed.out, printed.err

    return run


@pytest.fixture
def refused(call):
    """It must refuse, in one sentence, which is returned."""

    def run(*arguments: object) -> str:
        code, out, err = call(*arguments)
        assert (code, out, err.count("\n")) == (2, "", 1)
        return err.removeprefix("fit-material: ").rstrip("\n")

    return run


def strictly(text: str) -> dict:
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def result_of(scene: Path) -> Path:
    return scene.parent / "out" / "result.json"


def spoilt(scene: Path, change) -> Path:
    """The result with a change made to its content."""
    path = result_of(scene)
    data = json.loads(path.read_text("utf-8"))
    change(data)
    path.write_text(json.dumps(data), "utf-8")
    return path


# What comes out


def test_json_is_strict_and_ranked(fitted, call):
    code, out, err = call(fitted, "--result", result_of(fitted), "--json")
    assert (code, err) == (0, "")
    advice = strictly(out)
    assert list(advice) == ["format", "message", "now", "best", "candidates"]
    views = advice["candidates"]
    assert all(set(view) == set(VIEW.split()) for view in views)
    assert [view["ratio"] for view in views] == sorted(view["ratio"] for view in views)
    assert len(views) > 80
    assert {key: advice["best"][key] for key in VIEW.split()} == views[0]
    assert advice["best"]["nearest_view"] in ("view_0", "view_1")


def test_half_widths_are_those_of_the_result(fitted, call):
    """Of its own intervals; and expected are smaller ones."""
    advice = strictly(call(fitted, "--result", result_of(fitted), "--json")[1])
    (material,) = json.loads(result_of(fitted).read_text("utf-8"))["materials"]
    now, expected = advice["now"]["default"], advice["best"]["expected"]["default"]
    for key in ("n", "k", "f0"):
        assert now[key] == pytest.approx([(high - low) / 2 for low, high in material["interval95"][key]])
        assert all(0 < after < before for after, before in zip(expected[key], now[key], strict=True))
    low, high = material["interval95"]["alpha"]
    assert now["alpha"] == pytest.approx((high - low) / 2)
    assert now["roughness"] is None
    assert now["color"] is None


def test_the_sentence_has_a_camera_to_paste(scene, call):
    """The scene with it is one that can be read."""
    advice = strictly(call(scene, "--result", result_of(scene), "--json")[1])
    code, out, err = call(scene, "--result", result_of(scene))
    assert (code, err) == (0, "")
    sentence, _, table = out.partition("\n\n")
    assert sentence == advice["message"]
    assert sentence.startswith("A photograph from ")
    assert "would shrink" in sentence
    camera = tomllib.loads(table)["photographs"][0]["camera"]
    assert camera == {key: advice["best"][key] for key in ("origin", "target", "up", "fov")}
    scene.write_text(scene.read_text() + "\n" + table.replace("NEW.exr", "view_0.exr"))
    assert len(read_scene(scene).photographs) == 3


@pytest.mark.slow  # a fit
def test_without_a_result_the_scene_is_fitted_and_nothing_is_written(scene, call):
    before = {path: path.stat().st_mtime_ns for path in scene.parent.rglob("*")}
    code, out, err = call(scene, "--fidelity", "preview", "--type", "metal", "--json")
    assert (code, err) == (0, "")
    fresh, read = strictly(out), strictly(call(scene, "--result", result_of(scene), "--json")[1])
    assert fresh == read  # the same fit, and all chance by the same seed
    assert {path: path.stat().st_mtime_ns for path in scene.parent.rglob("*")} == before


@pytest.mark.slow
def test_where_no_view_helps_it_says_so(fitted, tmp_path, call):
    """Six photographs of some 2700 covered pixels each, of which a preview takes 3000 in all; so it does of seven."""
    scene = soft_scene(tmp_path / "large", gold(), views=6, size=64, spp=16)
    fit_scene(scene, scene.parent / "out", FitOptions(preset("preview"), type="metal"))
    code, out, err = call(scene, "--result", result_of(scene))
    assert (code, err) == (0, "")
    assert out.startswith("No further view helps much: the best, ")
    assert "A fit with --fidelity reference takes more pixels of the photographs there are: " in out
    assert "[photographs.camera]" not in out


# Slips


@pytest.mark.parametrize(("option", "value"), [("--fidelity", "standard"), ("--type", "metal"), ("--lobe", "beckmann")])
def test_what_the_result_says_is_not_said_twice(fitted, refused, option, value):
    told = refused(fitted, "--result", result_of(fitted), option, value)
    assert told == f"{option}: is {value}, expected no {option} beside --result, which says it"


def test_the_viewers_model_is_refused(fitted, refused):
    told = refused(fitted, "--fidelity", "viewer")
    assert told == f"--fidelity: is viewer, expected preview or standard or reference: {WHY}"
    assert tuple(PRESETS) == ("viewer", "preview", "standard", "reference")


def test_a_result_of_the_viewers_model_is_refused(scene, refused):
    path = spoilt(scene, lambda data: data["model"].update(fidelity="viewer", lobe="taps"))
    told = refused(scene, "--result", path)
    assert told == f"{path}: model.fidelity: is viewer with taps, expected preview or standard or reference: {WHY}"


def test_a_result_of_an_approximate_reflectance_is_refused(scene, refused):
    path = spoilt(scene, lambda data: data["model"].update(reflectance="lazanyi"))
    told = refused(scene, "--result", path)
    assert told == f"{path}: model.reflectance: is lazanyi, expected conductor: {WHY}"


def test_a_polished_result_is_as_good(scene, call):
    path = spoilt(scene, lambda data: data["model"].update(fidelity="preview, polished by Mitsuba's path tracer"))
    code, out, err = call(scene, "--result", path)
    assert (code, err) == (0, "")
    assert "would" in out


def test_another_scenes_result_is_refused(scene, refused):
    scene.write_text(scene.read_text().replace("scale = 1.0", "scale = 1.5"))
    told = refused(scene, "--result", result_of(scene))
    expected = f"expected {scene} as it was when it was fitted; fit again, or leave --result out"
    assert told == f"{result_of(scene)}: inputs: is of other files, {expected}"


def test_another_name_of_the_material_is_refused(scene, refused):
    path = spoilt(scene, lambda data: data["materials"][0].update(name="lid"))
    told = refused(scene, "--result", path)
    assert told == f"{path}: materials[0].name: is lid, expected the name of a material of {scene}: default"


@pytest.mark.parametrize(
    ("change", "field", "value"),
    [
        ({"n": None}, "n", "null"),
        ({"n": [0.2, -0.4, 1.0]}, "n", "[0.2, -0.4, 1.0]"),
        ({"k": [1e300, 1, 1]}, "k", "[1e+300, 1.0, 1.0]"),
        ({"alpha": 0.0}, "alpha", "0.0"),
        ({"type": "glossy"}, "color", "null"),
    ],
)
def test_results_that_no_fit_wrote_are_refused(scene, refused, change, field, value):
    path = spoilt(scene, lambda data: data["materials"][0].update(change))
    assert refused(scene, "--result", path).startswith(f"{path}: materials[0].{field}: is {value}, expected numbers ")


def test_a_result_without_materials_is_refused(scene, refused):
    path = spoilt(scene, lambda data: data.update(materials=[]))
    assert refused(scene, "--result", path).startswith(f"{path}: materials: is [], expected the materials that were")


def test_a_scene_without_photographs_is_refused(scene, refused):
    text = scene.read_text()
    scene.write_text("photographs = []\n" + text[: text.index("[[photographs]]")])
    assert refused(scene) == f"{scene}: photographs: is [], expected at least one entry"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["no.toml"], "no.toml: expected a readable scene file here (there is none)"),
        (["{scene}", "--result", "no.json"], "no.json: expected a result.json that can be read"),
        (["{scene}", "--result", "{scene}"], "expected strict JSON in UTF-8"),
        (["{result}"], "expected TOML"),
        (["{scene}", "--fidelity", "best"], "'best' is not one of 'viewer', 'preview', 'standard', 'reference'"),
        (["{scene}", "-o", "out"], "no such option: -o"),
        (["{scene}", "--device", "cuda:99"], "--device: is cuda:99, expected one that torch can use here"),
        ([], "missing argument"),
    ],
)
def test_slips_in_the_arguments(scene, refused, arguments, told):
    filled = [each.format(scene=scene, result=result_of(scene)) for each in arguments]
    assert told in refused(*filled)


@given(st.sampled_from(["n", "k", "alpha"]), st.floats(allow_nan=True, allow_infinity=True))
def test_no_number_in_a_result_ends_in_a_traceback(fitted, key, value):
    """Whatever stands there is refused, or taken for a material."""
    from fit_material.fitter.next_view.previous_result import material_of, read_earlier_result

    data = json.loads(result_of(fitted).read_text("utf-8"))
    data["materials"][0][key] = value if key == "alpha" else [value] * 3
    path = fitted.parent / "odd.json"
    path.write_text(json.dumps(data), "utf-8")
    try:
        material = material_of(read_earlier_result(path).materials[0])
    except InputError:
        return
    assert material.width.value.isfinite()
