"""`fit-material check` on photographs of gold that are spoilt in one way at a time, and what `fit` makes of it."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from PIL import Image as PillowImage

from fit_material.fitter.commands import app
from fit_material.renderer.images.image_file import read_image, write_exr
from tests.support.srgb_curve import encoded


def run(monkeypatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["fit-material", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        app.main()
    return int(ended.value.code or 0)


def set_rotation(scene, degrees):
    text = scene.read_text(encoding="utf-8")
    scene.write_text(text.replace("rotation = 0.0", f"rotation = {degrees}"), encoding="utf-8")


def turned(scene):
    set_rotation(scene, 180.0)
    return "environment-rotation", "environment.rotation", "set rotation = 0"


def mirrored(scene):
    path = scene.with_name("environment.exr")
    write_exr(path, np.ascontiguousarray(read_image(path).radiance[:, ::-1]))
    return "environment-mirrored", "environment.map", "mirror the map (reverse its columns) and set rotation = 0"


def tone_mapped(scene):
    for path in sorted(scene.parent.glob("view_*.exr")):
        image = read_image(path)
        assert image.alpha is not None
        write_exr(path, np.concatenate([encoded(image.radiance), image.alpha[..., None]], -1).astype(np.float32))
    return "encoding", "photographs", 'set encoding = "srgb", or use files as the camera recorded them'


def overexposed(scene):
    path = scene.with_name("view_1.exr")
    image = read_image(path)
    assert image.alpha is not None
    write_exr(path, np.concatenate([2 * image.radiance, image.alpha[..., None]], -1))
    return "exposure", "photographs[1] (view_1)", "set exposure = 2"


@pytest.mark.parametrize("spoil", [turned, mirrored, tone_mapped, overexposed])
def test_what_is_wrong_is_told_with_its_remedy(spoil, gold_scene, monkeypatch, capsys):
    kind, where, remedy = spoil(gold_scene)
    assert run(monkeypatch, "check", gold_scene, "--json") == 1
    found = json.loads(capsys.readouterr().out)["findings"]
    assert [each["kind"] for each in found] == [kind]
    assert (found[0]["where"], found[0]["value"].count("%")) == (where, 2)
    told, *number = found[0]["remedy"].rsplit("exposure = ", 1)
    wanted, *factor = remedy.rsplit("exposure = ", 1)
    assert told == wanted
    if factor:  # the coarse fit's, and of two photographs either may be the right one
        assert float(number[0]) == pytest.approx(float(factor[0]), rel=0.15)


def test_nothing_is_told_of_a_good_scene(gold_scene, monkeypatch, capsys):
    assert run(monkeypatch, "check", gold_scene, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"findings": []}


@pytest.mark.slow  # a check and a fit
def test_photographs_that_are_darker_than_any_material_are_told(gold_scene, monkeypatch, capsys):
    """By a factor of a million, as where exposures are given in units of their own."""
    text = gold_scene.read_text(encoding="utf-8").replace("exposure = 1.0", "exposure = 1e6")
    gold_scene.write_text(text, encoding="utf-8")
    assert run(monkeypatch, "check", gold_scene, "--json") == 1
    (found,) = json.loads(capsys.readouterr().out)["findings"]
    assert (found["kind"], found["where"]) == ("exposure", "photographs")
    assert 1e-7 < float(found["value"].split(" times")[0]) < 1e-5
    assert run(monkeypatch, "fit", gold_scene, "-o", gold_scene.parent / "out", "--fidelity", "preview") in (0, 1)
    assert "exposures or the environment's scale are wrong" in capsys.readouterr().out


@pytest.mark.parametrize("of", ["environment", "photographs"])
def test_a_scale_that_is_left_to_the_fit_is_not_wrong(of, gold_scene, monkeypatch, capsys):
    """Of a map that is three times too bright, by its own unit or by the photographs'."""
    path = gold_scene.with_name("environment.exr")
    write_exr(path, 3 * read_image(path).radiance)
    text = gold_scene.read_text(encoding="utf-8")
    if of == "environment":
        text = text.replace("[environment]", '[environment]\nscale = "fit"').replace("scale = 1.0\n", "")
    else:
        text = 'exposure = "fit"\n' + text.replace("exposure = 1.0\n", "")
    gold_scene.write_text(text, encoding="utf-8")
    assert run(monkeypatch, "check", gold_scene) == 0
    assert "nothing found" in capsys.readouterr().out


def test_wrong_input_is_no_finding(gold_scene, monkeypatch, capsys):
    gold_scene.with_name("view_1.exr").write_bytes(b"no picture")
    assert run(monkeypatch, "check", gold_scene) == 2
    assert "view_1.exr" in capsys.readouterr().err


def test_fit_warns_and_goes_on(gold_scene, monkeypatch, capsys, tmp_path):
    turned(gold_scene)
    asked = ("fit", gold_scene, "-o", tmp_path / "out", "--fidelity", "preview", "--pixels", 300, "--type", "metal")
    assert run(monkeypatch, *asked) in (0, 1)
    sentence = "Check: environment.rotation: turned by 180°: the coarse fit's residual falls from "
    assert capsys.readouterr().err.startswith(f"fit-material: {sentence}")
    told = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))["message"]
    assert sentence in told


@pytest.mark.slow
def test_a_check_that_fails_stops_no_fit(gold_scene, monkeypatch, capsys, tmp_path):
    def broken(*arguments):
        raise RuntimeError("of the check")

    monkeypatch.setattr("fit_material.fitter.input_checks.checks.preflight", broken)
    asked = ("fit", gold_scene, "-o", tmp_path, "--fidelity", "preview", "--pixels", 300, "--type", "metal")
    assert run(monkeypatch, *asked) in (0, 1)
    assert "could not be checked (of the check)" in capsys.readouterr().err
    assert run(monkeypatch, *asked, "--no-check") in (0, 1)
    assert not capsys.readouterr().err


def test_a_damaged_colour_profile_puts_nothing_before_the_json(gold_scene, monkeypatch, capfd):
    """libpng warns of it, and Mitsuba would print that, in colours, to standard output."""
    mask = gold_scene.with_name("mask.png")
    height, width = read_image(gold_scene.with_name("view_0.exr")).radiance.shape[:2]
    PillowImage.new("L", (width, height), 255).save(mask, icc_profile=b"no profile")
    text = gold_scene.read_text(encoding="utf-8")
    gold_scene.write_text(text.replace('image = "view_0.exr"', 'image = "view_0.exr"\nmask = "mask.png"'), "utf-8")
    run(monkeypatch, "check", gold_scene, "--json", "--quiet")
    printed = capfd.readouterr()
    assert printed.err == ""
    assert json.loads(printed.out).keys() == {"findings"}
