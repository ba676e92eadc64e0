"""The page on accuracy against time, from numbers that were made up so that what follows from them is known."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import pytest

from fit_material.fitter.frontier.errors import Reference
from fit_material.fitter.frontier.pareto import frontier_of
from fit_material.fitter.frontier.rungs import Rung
from fit_material.fitter.frontier.runs import Run
from fit_material.fitter.result.schema import FittedMaterial, Intervals, Time
from tests.bench.accuracy import Compared, page_text
from tests.bench.accuracy_advice import beyond, step, whom, worst_number
from tests.bench.accuracy_plot import accuracy_figure, accuracy_png
from tests.bench.accuracy_table import knee_sentence, medians_table, over_the_knee

GOLD: dict[str, Any] = {"n": (0.2, 0.4, 1.6), "k": (3.2, 2.4, 1.9), "f0": (0.93, 0.75, 0.4), "alpha": 0.2}
TRUTH = (Reference(name="default", type="metal", **GOLD),)
USUAL = {"preview": (2.0, 0.08), "standard": (4.0, 0.02), "reference": (32.0, 0.015)}
Points = dict[str, tuple[float, float]]


def fitted(off: float, half_width: float = 1.0) -> FittedMaterial:
    """Gold, n of red off by a share of itself, with that half width of its interval, in errors."""
    n = 0.2 * (1 + off)
    half = 0.2 * off * half_width
    intervals = Intervals(n=((n - half, n + half), (0.4, 0.4), (1.6, 1.6)))
    return FittedMaterial(name="default", type="metal", interval95=intervals, **{**GOLD, "n": (n, 0.4, 1.6)})


def run(rung: str, seconds: float, material: FittedMaterial | None) -> Run:
    """A run; one that took gold for clay where no material is given."""
    found = material or FittedMaterial(name="default", type="matte", color=(0.5, 0.5, 0.5))
    return Run(
        rung=rung,
        options=(),
        seed=0,
        status="converged",
        message="",
        command=seconds,
        peak=800 * 2**20,
        time=Time(load=1, prepare=0.1, solve=0.1, report=0.1, total=seconds),
        materials=(found,),
        picture=0.05,
    )


def compared(points: Points, material: str = "gold", environment: str = "park", width: float = 1.01) -> Compared:
    runs = [run(rung, seconds, fitted(off, width)) for rung, (seconds, off) in points.items()]
    rungs = [Rung(rung) for rung in points]
    return Compared(material, environment, frontier_of("scene", rungs, runs, TRUTH), runs, TRUTH)


def fits(cases: Sequence[Compared]) -> list[tuple[Sequence[Run], Sequence[Reference]]]:
    return [(case.runs, case.truth) for case in cases]


def test_each_preset_is_advised_for_what_it_is_best_at():
    told = whom([compared(USUAL).frontier])
    assert told == (
        "Take `preview` (median 2.0 s, worst error 8 %) where every second counts;"
        " `standard` (median 4.0 s, worst error 2 %) as the quickest within 2 times the least error;"
        " `reference` (median 32.0 s, worst error 1.5 %) for the least error at any price."
    )


def test_a_preset_that_another_beats_is_advised_to_nobody():
    told = whom([compared({"preview": (5.0, 0.08), "standard": (4.0, 0.01), "reference": (32.0, 0.03)}).frontier])
    assert "preview" not in told
    assert "reference" not in told
    assert told.count("standard") == 1


def test_advice_goes_by_medians_and_not_by_one_case():
    usual, odd = compared(USUAL).frontier, compared({**USUAL, "standard": (400.0, 0.9)}).frontier
    assert whom([usual, usual, odd]) == whom([usual])


def test_the_step_to_reference_is_told_case_by_case():
    """By hand: 8 and 4 times the seconds, 0.75 and 1.25 times the error."""
    worse = {"standard": (8.0, 0.02), "reference": (32.0, 0.025)}
    told = step([compared(USUAL).frontier, compared(worse).frontier])
    assert "takes 6 (4 … 8) times as long and leaves 1 (0.75 … 1.25) times the worst error" in told
    assert told.endswith("which falls in 1 of 2 cases.")
    assert step([compared({"preview": (1.0, 0.1), "standard": (2.0, 0.1)}).frontier]).endswith("was not measured.")


@pytest.mark.parametrize(("width", "held", "blamed"), [(1.01, 2, "photographs' own noise"), (0.99, 0, "model")])
def test_what_limits_follows_from_the_fits_own_intervals(width, held, blamed):
    cases = [compared(USUAL, width=width) for _ in range(2)]
    told = beyond([case.frontier for case in cases], fits(cases))
    assert "that of n (2), 1.5 % in the median case, and the fit's own 95 % interval holds the truth of that" in told
    assert f"in {held} of 2 fits" in told
    assert blamed in told


def test_the_number_that_errs_most_is_told_with_its_own_interval():
    """n of red errs by 2 %, alpha by 5 %; alpha's interval leaves the truth out, n's does not."""
    values = fitted(0.02, 1.01).model_dump() | {"alpha": 0.21}
    values["interval95"] = values["interval95"] | {"alpha": (0.205, 0.215)}
    assert worst_number(run("reference", 1.0, FittedMaterial.model_validate(values)), TRUTH) == ("alpha", False)
    assert worst_number(run("reference", 1.0, fitted(0.02, 1.01)), TRUTH) == ("n", True)
    assert worst_number(run("reference", 1.0, None), TRUTH) is None


def test_the_table_has_medians_and_late_percentiles_over_the_cases():
    """By hand, of errors 1, 2 … 10 %: the median is 5.5 %, the 90th percentile the next above, 10 %."""
    cases = [compared({"standard": (float(i), i / 100), "reference": (20.0, 0.005)}).frontier for i in range(1, 11)]
    row = next(line for line in medians_table(cases) if line.startswith("| standard"))
    assert [cell.strip() for cell in row.strip("|").split("|")][:4] == ["standard", "5.5 (1 … 10)", "800", "5.5, 10"]


def test_a_material_taken_for_another_counts_as_an_error_without_bound():
    runs = [run("standard", 4.0, None), run("reference", 32.0, fitted(0.01))]
    wrong = frontier_of("scene", [Rung("standard"), Rung("reference")], runs, TRUTH)
    row = next(line for line in medians_table([wrong, compared(USUAL).frontier]) if line.startswith("| standard"))
    assert "| –, – |" in row
    assert step([wrong]).endswith("was not measured.")


def test_the_standard_presets_seconds_are_told_in_those_of_the_knee():
    """The knee is standard in the first case; in the second it is preview, a third of standard's time away."""
    late = {"viewer": (1.0, 0.9), "preview": (2.0, 0.02), "standard": (6.0, 0.019), "reference": (32.0, 0.015)}
    cases = [compared(USUAL).frontier, compared(late).frontier]
    assert [case.knee for case in cases] == ["standard", "preview"]
    assert over_the_knee(cases) == [1.0, 3.0]
    assert "1 of 2 cases are within the goal of 2" in knee_sentence(cases)


def test_the_page_has_its_plot_one_table_and_three_sentences():
    cases = [compared(USUAL, material, light) for material in ("gold", "iron") for light in ("park", "night")]
    page = page_text(cases, "commit abc · two cores\nversions\n", "make it")
    assert "commit abc · two cores\nversions" in page
    assert "`make it`" in page
    assert "(accuracy.png)" in page
    assert page.count("\n|---") == 1
    advice = page.split("## Advice")[1].strip()
    assert len(re.findall(r"\.(?=\s|$)", advice)) == 3


def test_every_case_is_a_panel_with_its_knee_ringed():
    cases = [compared(USUAL, material, light) for material in ("gold", "iron", "clay") for light in ("park", "night")]
    panels = [(case.material, case.environment, case.frontier) for case in cases]
    figure = accuracy_figure(panels)
    assert len(figure.axes) == 6
    for axes in figure.axes:
        (ring,) = (line for line in axes.lines if line.get_label() == "knee")
        assert (ring.get_xdata()[0], ring.get_ydata()[0]) == pytest.approx((4.0, 2.0))  # s, %
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert accuracy_png(panels).startswith(b"\x89PNG")
