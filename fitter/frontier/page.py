"""The comparison of rungs as one self-contained page."""

from __future__ import annotations

import functools
import shlex

from markupsafe import Markup

from fit_material.fitter.frontier import table as words
from fit_material.fitter.frontier.pareto import STAGES, Frontier
from fit_material.fitter.frontier.plot import frontier_figure
from fit_material.fitter.html.svg import inline_svg
from fit_material.fitter.html.templates import page_templates


def render_frontier(frontier: Frontier, title: str, command: str = "") -> str:
    """Plot and table; nothing is loaded from elsewhere.

    Args:
        title: the comparison, as a sentence.
        command: the command line that made it, shown as it is; "" shows none.
    """
    page = page_templates()
    page.filters["shell"] = shlex.join
    for name in ("seconds_words", "price_words", "memory_words", "percent", "two_digits"):
        page.filters[name] = getattr(words, name)
    return page.get_template("frontier.html").render(
        title=title,
        frontier=frontier,
        sentences=words.sentences(frontier),
        plot=Markup(inline_svg(functools.partial(frontier_figure, frontier), "frontier")),
        stages=("command", "cpu", *STAGES[:-1]),
        errors=words.errors_shown(frontier),
        priced=any(row.price for row in frontier.rows),
        verdicts={row.rung: words.verdict(row, frontier) for row in frontier.rows},
        command=command,
    )
