"""The table of hard cases, row by row, in float32 and float64; and that its claims can fail."""

from __future__ import annotations

import json
import math

import pytest
import torch
from typer.testing import CliRunner

from fit_material.fitter.commands import app
from fit_material.fitter.selftest import claims, table
from fit_material.fitter.selftest.experiments.row import Formula, Numbers, Row
from fit_material.renderer.errors.input_error import InputError

CPU = torch.device("cpu")
DOUBLE = Numbers(torch.float64)
RUNS = table.runs(CPU)


@pytest.mark.parametrize(("row", "numbers"), [run[1:] for run in RUNS], ids=[f"{r.name}-{n}" for _, r, n in RUNS])
def test_the_row_holds(row: Row, numbers: Numbers):
    assert row.broken(numbers) == []


@pytest.mark.slow
@pytest.mark.parametrize("row", [row for row in table.ROWS if row.once], ids=lambda row: row.name)
def test_what_the_selftest_runs_once_holds_in_single_precision_too(row: Row):
    assert row.broken(Numbers(torch.float32)) == []


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")
@pytest.mark.parametrize("row", table.ROWS, ids=lambda row: row.name)
def test_the_row_holds_on_a_gpu(row: Row):
    for dtype in table.DTYPES:
        assert row.broken(Numbers(dtype, torch.device("cuda"))) == []


def test_the_table_covers_its_topics():
    assert len(table.ROWS) >= 60
    assert len({row.name for row in table.ROWS}) == len(table.ROWS)
    assert all(len(rows) >= 10 for rows in table.TOPICS.values())
    assert all(row.holds and row.given and row.hard and row.reference for row in table.ROWS)


def formula(function) -> Formula:
    return Formula(function, {"x": (0.0, 0.5, 1.0)}, {"x": (0.0, 1.0)})


def broken(claim, function) -> str | None:
    return claim.broken(formula(function), DOUBLE)


@pytest.mark.parametrize("function", [torch.log, torch.sqrt, lambda x: x / x], ids=["value", "slope", "nan"])
def test_what_is_not_finite_is_found(function):
    assert "expected a finite" in broken(claims.FINITE, function)


def test_a_wrong_slope_is_found_at_the_ends_of_the_domain_too():
    """The step of a root has the slope 0 to torch; at 0 and 1 differences are one-sided."""
    assert broken(claims.gradient(), lambda x: x**3 + torch.exp(x)) is None
    for place in (0.0, 0.5, 1.0):
        wrong = broken(claims.gradient(), lambda x, place=place: x + (x - x.detach()) * (x == place) * 1e-3)
        assert f"at x = {place:g}" in wrong


def test_what_leaves_its_interval_is_found():
    assert broken(claims.between(0, 1), lambda x: x) is None
    assert "at x = 1, expected 0 to 0.9" in broken(claims.between(0, 0.9), lambda x: x)
    assert "expected 0 to 1" in broken(claims.between(0, 1), lambda x: x * math.nan)


def test_a_cancellation_is_found():
    """(1 + x) - 1 loses what x has below ε; x itself does not."""
    small = Formula(lambda x: (1 + x) - 1, {"x": (1e-12,)})
    assert claims.near(lambda x: x, 8).broken(small, DOUBLE)
    assert claims.near(lambda x: x, 8).broken(Formula(lambda x: 1 * x, {"x": (1e-12,)}), DOUBLE) is None
    assert claims.float32(8).broken(Formula(lambda x: (1 + x) - 1, {"x": (1e-5,)}), Numbers(torch.float32))


def test_a_fall_is_found():
    assert broken(claims.rising("x"), lambda x: x) is None
    assert "no less than before" in broken(claims.rising("x"), lambda x: -x)


def test_a_refusal_is_told_from_a_result_and_from_an_error():
    refusing = Row("r", "h", "g", refuse, (claims.refused("a number"),), "-")
    assert refusing.broken(DOUBLE) == []
    assert "was taken" in Row("r", "h", "g", lambda numbers: 1, refusing.holds, "-").broken(DOUBLE)[0]
    assert (
        "raised ZeroDivisionError" in Row("r", "h", "g", lambda numbers: 1 / 0, refusing.holds, "-").broken(DOUBLE)[0]
    )


def refuse(numbers: Numbers) -> None:
    raise InputError("file", expected="a number")


@pytest.fixture
def two_rows(monkeypatch) -> None:
    """A table of one row that holds and one that does not."""
    rows = [
        Row(name, "h", "g", lambda numbers, off=off: off, (claims.within(lambda numbers: 1.0),), "-", once=True)
        for name, off in (("good", 0.5), ("bad", 2.0))
    ]
    monkeypatch.setattr(table, "TOPICS", {"lobe": (rows[0],), "fit": (rows[1],)})


def test_selftest_tells_what_is_broken(two_rows):
    found = CliRunner().invoke(app.app, ["selftest"])
    assert found.exit_code == 1
    assert "bad, float64: near: is off by 2, expected at most 1" in found.output
    assert "1 of 2 runs of 2 rows hold" in found.output
    assert f"torch {torch.__version__}" in found.output


def test_selftest_as_json(two_rows):
    found = CliRunner().invoke(app.app, ["selftest", "--json"])
    told = json.loads(found.stdout)
    assert found.exit_code == 1
    assert told["holds"] is False
    assert told["versions"]["torch"] == torch.__version__
    assert [(row["name"], row["holds"]) for row in told["rows"]] == [("good", True), ("bad", False)]


def test_selftest_where_all_holds(monkeypatch, two_rows):
    monkeypatch.setattr(table, "TOPICS", {"lobe": table.TOPICS["lobe"]})
    assert CliRunner().invoke(app.app, ["selftest"]).exit_code == 0
