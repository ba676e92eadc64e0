"""Plots as SVG inside of pages: no addresses, no fonts, lines and letters in the page's own ink."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import TYPE_CHECKING

from fit_material.fitter.html.plotting import own_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK = "#102030"
"""Stands for the page's text colour until the SVG is finished."""


def inline_svg(draw: Callable[[], Figure], name: str) -> str:
    """A figure as an `<svg>` element to put into a page.

    Args:
        draw: makes the figure; what it leaves to matplotlib's defaults has the page's ink.
        name: keeps the ids of one page's figures apart; never shown.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    parts = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    inked = dict.fromkeys(parts, INK)
    with own_settings({"svg.fonttype": "none", "svg.hashsalt": name, "font.size": 10, **inked}):
        text = io.StringIO()
        FigureCanvasSVG(draw()).print_svg(text)
    return _element(text.getvalue())


def _element(svg: str) -> str:
    """The `<svg>` element alone: no declarations, licence, addresses, or ids that could collide."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"| id="[\w.]+_\d+"|<!--.*?-->', "", svg, flags=re.DOTALL)
    svg = re.sub(r' width="[\d.]+pt" height="[\d.]+pt"', "", svg, count=1)
    return svg.replace(INK, "currentColor")
