"""The comparison of rungs as a plot: error against time, and where the time goes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fit_material.fitter.frontier.pareto import LEAST, STAGES, Frontier, Row, Spread
from fit_material.fitter.html.plotting import own_settings
from fit_material.fitter.html.svg import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GOLD, QUIET = "#a8741a", "#9a9ea3"
STAGE_COLORS = ("#c9a25b", "#7d9bb8", "#4f7a6b", "#b9785f", "#c9c5be")  # the report's
DOTS_PER_INCH = 150
SHORT = 6.0  # an axis whose ends differ by no more has few of 1, 2, 5, 10 on it
NAMES_OF_ERRORS = {"worst": "largest error of n, k, F0, alpha, colour", "picture": "difference from the photographs"}


def frontier_png(frontier: Frontier) -> bytes:
    """The plot on white."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with own_settings({"font.size": 10}):
        file, figure = io.BytesIO(), frontier_figure(frontier)
        figure.patch.set_visible(True)
        FigureCanvasAgg(figure).print_png(file)
    return file.getvalue()


def frontier_figure(frontier: Frontier) -> Figure:
    """Left the points of all rungs that have an error, right the stages' seconds of all."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.6), layout="constrained", dpi=DOTS_PER_INCH)
    figure.patch.set_visible(False)
    points, bars = figure.subplots(1, 2, width_ratios=(1.5, 1))
    _draw_points(points, frontier)
    _draw_stages(bars, frontier)
    return figure


def _draw_points(axes: Axes, frontier: Frontier) -> None:
    placed = [(row, point) for row in frontier.rows if (point := row.point(frontier.by)) is not None]
    axes.set(xscale="log", yscale="log", xlabel="seconds of the whole command", ylabel=_label(frontier.by))
    if placed:
        axes.set_xlim(_extent([row.seconds["command"] for row, _ in placed], 1, (1.1, 1.5)))
        axes.set_ylim(_extent([row.errors[frontier.by] for row, _ in placed], 100, (1.3, 1.5)))
    front = [point for name in frontier.frontier for row, point in placed if row.rung == name]
    axes.plot([x for x, _ in front], [100 * y for _, y in front], color=GOLD, linewidth=1.2, zorder=1)
    for index, (row, point) in enumerate(sorted(placed, key=lambda each: each[1][1])):
        _draw_point(axes, row, point, frontier)
        _name_point(axes, row, point, frontier, above=index % 2 == 0)
    plain_ticks(axes)
    quiet_frame(axes)


def _draw_point(axes: Axes, row: Row, point: tuple[float, float], frontier: Frontier) -> None:
    time, error = row.seconds["command"], row.errors[frontier.by]
    assert time is not None
    assert error is not None
    beaten, knee = row.beaten_by is not None, row.rung == frontier.knee
    color, (x, y) = QUIET if beaten else GOLD, (point[0], 100 * point[1])
    axes.plot([time.low, time.high], [y, y], color=color, linewidth=1, zorder=1)
    axes.plot([x, x], [100 * max(error.low, LEAST), 100 * max(error.high, LEAST)], color=color, linewidth=1, zorder=1)
    axes.plot(x, y, "o", markersize=6, color=color, markerfacecolor="none" if beaten else color, zorder=2)
    if knee:
        axes.plot(x, y, "o", markersize=13, markeredgecolor=GOLD, markerfacecolor="none", zorder=2)


def _name_point(axes: Axes, row: Row, point: tuple[float, float], frontier: Frontier, above: bool) -> None:
    """In turn above and below the dots, by error, so that names of dots at one height do not meet."""
    text = f"{row.rung}, knee" if row.rung == frontier.knee else row.rung
    color, way = QUIET if row.beaten_by else INK, (8, 5 if above else -13)
    axes.annotate(text, (point[0], 100 * point[1]), way, textcoords="offset points", fontsize=9, color=color)


def _extent(spreads: Sequence[Spread | None], unit: float, room: tuple[float, float]) -> tuple[float, float]:
    """From the least to the most, with factors of room on both sides: names stand beside their dots."""
    known = [spread for spread in spreads if spread is not None]
    low, high = min(spread.low for spread in known), max(spread.high for spread in known)
    return unit * max(low, LEAST) / room[0], unit * max(high, LEAST) * room[1]


def _draw_stages(axes: Axes, frontier: Frontier) -> None:
    rows = [row for row in frontier.rows if row.seconds["command"] is not None]
    left = [0.0] * len(rows)
    for stage, color in zip(STAGES[:-1], STAGE_COLORS, strict=False):
        widths = [_median(row, stage) for row in rows]
        axes.barh(range(len(rows)), widths, left=left, color=color, label=stage, height=0.62)
        left = [a + b for a, b in zip(left, widths, strict=True)]
    rest = [max(_median(row, "command") - done, 0.0) for row, done in zip(rows, left, strict=True)]
    axes.barh(range(len(rows)), rest, left=left, color=STAGE_COLORS[-1], label="start of Python", height=0.62)
    axes.set(xlabel="seconds", yticks=range(len(rows)), yticklabels=[row.rung for row in rows])
    axes.invert_yaxis()
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False, fontsize=9)
    quiet_frame(axes)


def _median(row: Row, stage: str) -> float:
    spread = row.seconds[stage]
    return 0.0 if spread is None else spread.median


def _label(by: str) -> str:
    return f"{NAMES_OF_ERRORS.get(by, f'error of {by}')}, %"


def plain_ticks(axes: Axes) -> None:
    """Numbers as they are, and not as powers of ten: of a short axis one at every digit."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    for axis in (axes.xaxis, axes.yaxis):
        low, high = axis.get_view_interval()
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high > SHORT * low else range(1, 10)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())


def quiet_frame(axes: Axes) -> None:
    """Two spines, and a faint grid behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.15, color=INK, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.patch.set_visible(False)
