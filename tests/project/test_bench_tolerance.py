"""What the calibration of `--tolerance` makes of results and truths that were made up."""

from __future__ import annotations

import math
from typing import Any

import pytest

from fit_material.fitter.result.schema import Determined, FittedMaterial, Rung, Time, Tolerance
from tests.bench import fits
from tests.bench.estimates import SLICES, true_numbers
from tests.bench.fits import How
from tests.bench.grid import Selection
from tests.bench.photographs import Case
from tests.bench.tolerance import Outcome, case_row, one_for_each_alpha, summary
from tests.fitter.result.test_schema import result

IRON = Case("Fe", 0.1)
EVERY: dict[str, Any] = dict.fromkeys(("f0", "n", "k"), (True,) * 3) | {"alpha": True}


def fitted(factors: dict[str, Any], **determined: Any) -> FittedMaterial:
    """Iron with numbers multiplied by factors, channel by channel."""
    truth = true_numbers(IRON)
    values = {key: (truth[place] * factors.get(key, 1.0)).tolist() for key, place in SLICES.items()}
    (alpha,) = values.pop("alpha")
    return FittedMaterial(
        name="ball", type="metal", alpha=alpha, determined=Determined(**(EVERY | determined)), **values
    )


def outcome(promised: float | None, factors: dict[str, Any], reached: bool = True, **determined: Any) -> Outcome:
    first, last = (
        Rung(pixels=3000, samples=256, levels=5, movement=movement, of=movement and "n of red", seconds=1.0)
        for movement in (0.5, promised)
    )
    told = Tolerance(material="ball", asked=0.01, reached=reached, hopeless=(), rungs=(first, last))
    time = Time(load=1, prepare=1, solve=1, report=1, total=4.0)
    return Outcome(IRON, result(materials=(fitted(factors, **determined),), tolerance=(told,), time=time))


def test_the_last_effort_is_the_promise_and_the_largest_relative_error_the_truth():
    found = outcome(0.02, {"n": (1.0, 1.01, 0.97), "alpha": 1.02})
    assert found.pair == (0.02, pytest.approx(0.03))
    assert found.worst == ("n B", pytest.approx(0.03))


def test_numbers_that_are_not_determined_were_not_promised():
    found = outcome(0.02, {"n": (1.0, 1.01, 0.97)}, n=(True, True, False))
    assert found.pair == (0.02, pytest.approx(0.01))
    nothing = {"n": (False,) * 3, "k": (False,) * 3, "f0": (False,) * 3, "alpha": False}
    assert outcome(None, {}, **nothing).pair is None


def test_a_metal_taken_for_clay_breaks_every_promise():
    found = outcome(0.02, {})
    assert not isinstance(found.result, str)
    clay = FittedMaterial(name="ball", type="matte", color=(0.5, 0.5, 0.5))
    assert Outcome(IRON, found.result.model_copy(update={"materials": (clay,)})).pair == (0.02, math.inf)


def test_the_calibration_by_hand():
    """Promised over true: 2, 4, 0.5, and one fit that went wrong; of three promises two are kept."""
    every = [
        outcome(0.01, {"alpha": 1.005}),
        outcome(0.01, {"alpha": 1.0025}),
        outcome(0.01, {"alpha": 1.02}, reached=False),
        Outcome(IRON, "RuntimeError: no"),
    ]
    told = "\n".join(summary(every))
    assert "true ≤ promised: 66.7% ± 27.2% of 3 cases" in told  # (2/3 · 1/3 / 3)^½
    assert "promised / true: 2.00 in the median" in told
    assert f"above 1: {IRON.label} × 2.00\n" in told
    assert "reached 1%: 50.0%" in told
    assert f"no result: {IRON.label}\n" in told
    assert "seconds in process: 4.00 in the median, 90th percentile 4.00" in told


def test_a_fit_that_went_wrong_has_a_row_and_no_figures():
    row = case_row(Outcome(IRON, "RuntimeError: no"))
    assert "RuntimeError: no" in row
    assert row.count("|") == case_row(outcome(0.01, {"alpha": 1.02})).count("|") == 12


def test_every_alpha_has_a_command_and_metals_and_environments_change_with_it():
    chosen = one_for_each_alpha(Selection(("Au", "Fe", "W"), (0.05, 0.1, 0.2, 0.4), ("a", "b")))
    assert [(case.metal, case.alpha, case.environment) for case in chosen] == [
        ("Au", 0.05, "a"),
        ("Fe", 0.1, "b"),
        ("W", 0.2, "a"),
        ("Au", 0.4, "b"),
    ]


def test_fits_to_a_tolerance_are_kept_apart_from_others(tmp_path, monkeypatch):
    """What is asked of the fit, by a stand-in that notes it; a second time nothing is fitted."""
    asked = []

    def fit(scene, folder, options):
        asked.append(options.tolerance)
        (folder / "result.json").write_text(result().model_dump_json())

    monkeypatch.setattr(fits, "CACHE", tmp_path)
    monkeypatch.setattr(fits, "fit_scene", fit)
    for how in (How(), How(tolerance=0.01), How(tolerance=0.02), How(tolerance=0.01)):
        fits.result_of(tmp_path / "ball" / "scene.toml", how)
    assert asked == [None, 0.01, 0.02]
