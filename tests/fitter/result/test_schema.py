import hashlib
import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from fit_material.fitter.result.schema import (
    Correlation,
    Determined,
    Effect,
    FittedMaterial,
    InputFile,
    Intervals,
    Model,
    Nearest,
    PhotographQuality,
    PictureQuality,
    Quality,
    Result,
    Rung,
    StandardErrors,
    Time,
    Tolerance,
    read_result,
    write_result,
)
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.digests import sha256_of

PARAMETERS = {"n", "k", "f0", "alpha", "roughness", "color", "reflectance"}


def gold(**changes) -> FittedMaterial:
    values = {
        "name": "ball",
        "type": "metal",
        "n": (0.15, 0.43, 1.4),
        "k": (3.5, 2.3, 1.9),
        "f0": (0.96, 0.77, 0.39),
        "alpha": 0.2,
        "roughness": 0.55,
        "stderr": StandardErrors(n=(0.02, 0.04, None), f0=(0.002, 0.002, 0.002), alpha=0.001),
        "interval95": Intervals(n=((0.11, 0.19), (0.34, 0.52), None), alpha=(0.198, 0.202)),
        "determined": Determined(n=(True, True, False), alpha=True),
        "nearest": (Nearest(name="Au", distance=0.8),),
    }
    return FittedMaterial(**{**values, **changes})


def result(**changes) -> Result:
    picture = {"rms_relative": 0.02, "psnr": 41.0, "ssim": None}
    values = {
        "status": "converged",
        "message": "nine steps ∎ [\n 1,\n 2]",
        "materials": (gold(),),
        "quality": Quality(
            overall=PictureQuality(**picture), photographs=(PhotographQuality(name="a.exr", **picture),)
        ),
        "exposure": (1.0,),
        "model": Model(
            fidelity="standard",
            reflectance="conductor",
            lobe="ggx",
            samples=512,
            pixels=4000,
            dtype="float32",
        ),
        "effects": (Effect(name="reflection", on=True, why="a metal"),),
        "time": Time(load=1, prepare=7, solve=0.4, report=1, total=10),
        "inputs": (InputFile(path="scene.toml", sha256="0" * 64),),
    }
    return Result(**{**values, **changes})


def strictly_parsed(path):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def test_keys_are_the_contracts(tmp_path):
    write_result(result(), tmp_path / "result.json")
    data = strictly_parsed(tmp_path / "result.json")
    top = "format status message materials quality exposure model effects time inputs"
    assert list(data) == top.split()
    material = data["materials"][0]
    parts = {"name", "type", "stderr", "interval95", "determined", "nearest", "from_prior", "correlation"}
    assert set(material) == PARAMETERS | parts
    assert all(set(material[part]) == PARAMETERS for part in ("stderr", "interval95", "determined"))
    assert material["color"] is None
    assert material["stderr"]["n"] == [0.02, 0.04, None]
    assert material["interval95"]["alpha"] == [0.198, 0.202]
    assert set(data["quality"]["overall"]) == {"rms_relative", "psnr", "ssim"}
    named = {"levels", "environment_size"}
    assert set(data["model"]) == {"fidelity", "reflectance", "lobe", "samples", "pixels", "dtype"} | named
    assert set(data["time"]) == {"load", "prepare", "solve", "report", "total"}


def test_a_tolerance_is_told_where_one_was_asked_for(tmp_path):
    rung = Rung(pixels=3000, samples=256, levels=5, movement=0.02, of="n of red", seconds=3.5)
    asked = Tolerance(material="default", asked=0.01, reached=False, hopeless=("n of red",), rungs=(rung,))
    written = result(tolerance=(asked,))
    write_result(written, tmp_path / "result.json")
    assert strictly_parsed(tmp_path / "result.json")["tolerance"][0]["rungs"][0]["movement"] == 0.02
    assert read_result(tmp_path / "result.json") == written


def test_correlations_are_a_square_of_coefficients():
    assert Correlation(numbers=("a", "b"), coefficients=((1, 0.5), (0.5, 1))).coefficients[0] == (1, 0.5)
    for wrong in (((1, 0.5),), ((1, 0.5), (0.5,)), ((1, 1.5), (1.5, 1))):
        with pytest.raises(ValueError, match="coefficients"):
            Correlation(numbers=("a", "b"), coefficients=wrong)


finite = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(n=st.tuples(finite, finite, finite), alpha=finite, message=st.text(st.characters(codec="utf-8")))
def test_every_float_and_text_comes_back_exactly(tmp_path, n, alpha, message):
    written = result(materials=(gold(n=n, alpha=alpha),), message=message)
    write_result(written, tmp_path / "result.json")
    assert read_result(tmp_path / "result.json") == written
    assert strictly_parsed(tmp_path / "result.json")["materials"][0]["n"] == list(n)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_what_is_not_finite_is_refused(bad):
    with pytest.raises(ValidationError, match=r"n\.1\n.*finite number"):
        gold(n=(1.0, bad, 1.0))
    with pytest.raises(ValidationError, match="finite number"):
        StandardErrors(alpha=bad)
    with pytest.raises(ValidationError, match="finite number"):
        PictureQuality(rms_relative=None, psnr=bad, ssim=None)


def test_an_interval_is_low_then_high():
    with pytest.raises(ValidationError, match="low ≤ high"):
        Intervals(alpha=(2.0, 1.0))


def test_a_result_does_not_change():
    with pytest.raises(ValidationError, match="frozen"):
        result().status = "stopped"  # pyright: ignore


def edited(path, edit) -> str:
    write_result(result(), path)
    data = json.loads(path.read_text())
    edit(data)
    path.write_text(json.dumps(data))
    with pytest.raises(InputError) as caught:
        read_result(path)
    return str(caught.value).removeprefix(f"{path}: ")


def test_wrong_fields_are_named(tmp_path):
    path = tmp_path / "result.json"
    material = "materials[0]"
    nan = edited(path, lambda data: data["materials"][0]["n"].__setitem__(1, float("nan")))
    assert nan == f"{material}.n[1]: is nan, expected a finite number"
    missing = edited(path, lambda data: data["materials"][0].pop("type"))
    assert missing == f"{material}.type: expected a value here, but it is missing"
    unknown = edited(path, lambda data: data.update(mesage=1))
    assert unknown == "mesage: is 1, expected a known key, the nearest is message"
    assert edited(path, lambda data: data.update(format=2)) == "format: is 2, expected 1"
    text = edited(path, lambda data: data["materials"][0].update(alpha="rough"))
    assert text.startswith(f'{material}.alpha: is "rough", expected a number')
    status = edited(path, lambda data: data.update(status="fine"))
    assert status == "status: is \"fine\", expected 'converged', 'not_determined' or 'stopped'"
    interval = edited(path, lambda data: data["materials"][0]["interval95"].update(alpha=[2, 1]))
    assert interval.endswith("interval95.alpha: is [2, 1], expected an interval [low, high] with low ≤ high")


def test_files_that_are_no_result(tmp_path):
    path = tmp_path / "result.json"
    with pytest.raises(InputError, match="No such file"):
        read_result(path)
    for content in (b"{", b"\xff\xfe"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"result.json: expected strict JSON in UTF-8 \("):
            read_result(path)
    path.write_text("[]")
    with pytest.raises(InputError, match=r"result.json: is \[\], expected"):
        read_result(path)


def test_sha256(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    # the example of FIPS 180-2, appendix B.1
    assert sha256_of(tmp_path / "a") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert sha256_of(tmp_path / "a") == hashlib.sha256(b"abc").hexdigest()
    with pytest.raises(InputError, match="No such file"):
        sha256_of(tmp_path / "b")


def test_numbers_of_thousands_of_digits_are_refused(tmp_path):
    (tmp_path / "a").write_text("1" * 5000)
    with pytest.raises(InputError, match=r"a: expected strict JSON without numbers of thousands of digits$"):
        read_result(tmp_path / "a")
