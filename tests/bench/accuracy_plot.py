"""Error against time as small multiples: materials down, environments across."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from fit_material.fitter.frontier.pareto import LEAST, Frontier, Row
from fit_material.fitter.frontier.plot import DOTS_PER_INCH, NAMES_OF_ERRORS, QUIET, plain_ticks, quiet_frame
from fit_material.fitter.html.svg import INK
from tests.bench.accuracy_table import rungs_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Panel = tuple[str, str, Frontier]
"""Material, environment, and the ladder's comparison there."""
WIDTH, HEIGHT, ABOVE = 3.3, 2.6, 0.9  # inches of a panel, and of the legend


def accuracy_png(panels: Sequence[Panel]) -> bytes:
    """The figure on white."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with rc_context(rc={"font.size": 9}):
        file = io.BytesIO()
        FigureCanvasAgg(accuracy_figure(panels)).print_png(file)
    return file.getvalue()


def accuracy_figure(panels: Sequence[Panel]) -> Figure:
    """All panels have the same axes."""
    from matplotlib.figure import Figure

    materials, environments = (list(dict.fromkeys(panel[i] for panel in panels)) for i in (0, 1))
    size = (WIDTH * max(2, len(environments)), HEIGHT * len(materials) + ABOVE)
    figure = Figure(figsize=size, layout="constrained", dpi=DOTS_PER_INCH)
    grid = figure.subplots(len(materials), len(environments), sharex=True, sharey=True, squeeze=False)
    colors = _colors(rungs_of([frontier for *_, frontier in panels]))
    for material, environment, frontier in panels:
        _draw(grid[materials.index(material), environments.index(environment)], frontier, colors)
    for axes in grid.flat:
        plain_ticks(axes)
    for axes, environment in zip(grid[0], environments, strict=True):
        axes.set_title(environment, fontsize=9)
    for axes, material in zip(grid[:, 0], materials, strict=True):
        axes.set_ylabel(material)
    figure.supxlabel("seconds of the whole command", fontsize=9)
    figure.supylabel(f"{NAMES_OF_ERRORS['worst']}, %", fontsize=9)
    _name_colors(figure, colors)
    return figure


def _colors(rungs: Sequence[str]) -> Mapping[str, str]:
    """From pale to dark along the ladder."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    shades = colormaps["viridis_r"]
    return {rung: to_hex(shades(0.08 + 0.92 * i / max(1, len(rungs) - 1))) for i, rung in enumerate(rungs)}


def _draw(axes: Axes, frontier: Frontier, colors: Mapping[str, str]) -> None:
    axes.set(xscale="log", yscale="log")
    placed = {row.rung: (row, point) for row in frontier.rows if (point := row.point(frontier.by)) is not None}
    front = [placed[rung][1] for rung in frontier.frontier]
    axes.plot([x for x, _ in front], [100 * y for _, y in front], color=QUIET, linewidth=1, zorder=1)
    for rung, (row, (x, y)) in placed.items():
        color, hollow = colors[rung], row.beaten_by is not None
        _draw_spread(axes, row, (x, 100 * y), color)
        axes.plot(x, 100 * y, "o", markersize=6, color=color, markerfacecolor="white" if hollow else color, zorder=3)
        if rung == frontier.knee:
            axes.plot(
                x, 100 * y, "o", markersize=12, markeredgecolor=INK, markerfacecolor="none", zorder=4, label="knee"
            )
    quiet_frame(axes)


def _draw_spread(axes: Axes, row: Row, at: tuple[float, float], color: str) -> None:
    """From the least to the most of the repeats."""
    time, error = row.seconds["command"], row.errors["worst"]
    assert time is not None
    assert error is not None
    x, y = at
    axes.plot([time.low, time.high], [y, y], color=color, linewidth=1, zorder=2)
    axes.plot([x, x], [100 * max(end, LEAST) for end in (error.low, error.high)], color=color, linewidth=1, zorder=2)


def _name_colors(figure: Figure, colors: Mapping[str, str]) -> None:
    from matplotlib.lines import Line2D

    dots = [Line2D([], [], marker="o", linestyle="", color=color, label=rung) for rung, color in colors.items()]
    ring = Line2D([], [], marker="o", linestyle="", markersize=10, color=INK, markerfacecolor="none", label="knee")
    figure.legend(handles=[*dots, ring], loc="outside upper center", ncols=4, frameon=False)
