"""Plots are ours, whatever the user's settings of matplotlib are."""

from __future__ import annotations

import matplotlib
import pytest

from fit_material.fitter.frontier.pareto import frontier_of
from fit_material.fitter.frontier.plot import frontier_png
from fit_material.fitter.html.svg import inline_svg
from tests.fitter.frontier.test_pareto import TRUTH, run, rungs


@pytest.fixture
def latex():
    """Settings of a user who writes papers; there need be no LaTeX."""
    with matplotlib.rc_context({"text.usetex": True, "font.family": ["nonsense"], "axes.titlesize": 40.0}):
        yield


def figure():
    from matplotlib.figure import Figure

    made = Figure()
    made.subplots().set_title("n of Σ_x $")
    return made


def test_a_pages_plots_are_the_same_for_everybody(request):
    usual = inline_svg(figure, "a")
    request.getfixturevalue("latex")
    assert inline_svg(figure, "a") == usual
    assert matplotlib.rcParams["text.usetex"]  # the user's again


def test_the_frontiers_plot_is_the_same_for_everybody(request):
    found = frontier_of("scene", rungs("a", "b"), [run("a"), run("b", command=20.0, n=0.201)], TRUTH)
    usual = frontier_png(found)
    request.getfixturevalue("latex")
    assert frontier_png(found) == usual
