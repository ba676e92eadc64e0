"""A batch as one self-contained page, beside the same as JSON."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

from fit_material.fitter.batch.summary import WORDS, Scene, Summary, json_text, sentence
from fit_material.fitter.batch.table import OPEN, lines, shown_of
from fit_material.fitter.html.templates import page_templates
from fit_material.fitter.result.formatting import HEADLINE
from fit_material.renderer.files.atomic import replaced_together, write_text_atomically


def write_summary(summary: Summary, out: Path) -> None:
    """Write `summary.html` and `summary.json`, both or neither.

    Raises:
        InputError: the folder cannot be written.
    """
    with replaced_together(out, last="summary.json") as folder:
        write_text_atomically(folder / "summary.html", render_summary(summary))
        write_text_atomically(folder / "summary.json", json_text(summary))


def render_summary(summary: Summary) -> str:
    """A table of all scenes, with links to their reports; nothing is loaded from elsewhere."""
    page = page_templates()
    page.filters["lines"] = lines
    page.filters["report"] = _report
    return page.get_template("batch.html").render(
        summary=summary,
        told=sentence(summary),
        shown=shown_of(summary, HEADLINE),
        words=WORDS,
        open=OPEN,
        command=summary.command,
    )


def _report(scene: Scene) -> str:
    """Where the scene's report is, from the page."""
    return quote(f"{scene.name}/report.html")
