"""The table of hard cases as a page, with a metal's lobe at hard places by us, by Mitsuba, and by textbook formulas."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import torch

from fit_material.fitter.selftest.table import ROWS, TOPICS, Verdict, verdicts
from fit_material.renderer.files.atomic import write_text_atomically
from tests.bench.peers import PLACES, RIGHT, compared
from tests.bench.setting import header

MEANINGS = {
    "finite": "no NaN and no infinity, in values and derivatives, or in all that an experiment gives",
    "bounded": "inside the interval that physics allows, up to rounding",
    "monotone": "never falls, or never rises, where the formula does not",
    "near": "no further from the reference than rounding may bring it by its conditioning, or by what is said there",
    "float32": "the same, float64 being the reference",
    "gradient": "derivatives are those of differences in float64, to 1e-4, a thousandth of the input's scale apart",
    "continuous": "no jump, beyond what the slope explains",
    "invariant": "what should change nothing moves nothing, beyond rounding or a tenth of a standard error",
    "robust": "one wrong pixel moves no number by its standard error",
    "honest": "what is not known is not called determined, and the message says why",
    "finite, no worse, honest": "numbers, a cost no higher than the start's, and a status that is true",
    "refused": "one sentence says what is wrong",
    "left out and counted": "without the broken pixel, which the result tells of",
    "repaired and reported": "with another value for the broken texel, which the result tells of",
}
"""What the words of "must hold" say."""


def rows(variant: str, out: Path) -> Iterator[str]:
    """A line for each row that does not hold; then the page, which is written as `hard-cases.md`."""
    begun = header()
    found = verdicts(torch.device("cpu"))
    yield from (f"- {each.row.name}, {each.numbers}: {' '.join(each.broken)}" for each in found if not each.holds)
    peers, command = list(side_by_side()), shlex.join(["python", "-m", "tests.bench", *sys.argv[1:]])
    page = page_text(found, peers, begun, command)
    out.mkdir(parents=True, exist_ok=True)
    write_text_atomically(out / "hard-cases.md", page)
    yield f"{sum(each.holds for each in found)} of {len(found)} runs of {len(ROWS)} rows hold"
    yield ""
    yield from peers


def page_text(found: list[Verdict], peers: list[str], measured: str, command: str) -> str:
    """The page, from the table and what was measured, and nothing else."""
    held = sum(each.holds for each in found)
    lines = [
        "# Hard cases",
        "",
        f"Made by `{command}` from the table in `fitter/selftest` and what was measured; do not edit.",
        "",
        *measured.strip().splitlines(),
        "",
        f"{len(ROWS)} rows; {held} of {len(found)} runs in float32 and float64 hold. `fit-material selftest` runs them"
        " on your machine, `tests/fitter/selftest/test_table.py` before every change. What must hold, in words:",
        "",
        *(f"- *{word}*: {meaning}." for word, meaning in MEANINGS.items()),
        "",
    ]
    for topic, rows in TOPICS.items():
        lines += [f"## {topic.capitalize()}", "", "| case | what is hard | input | must hold | against | holds |"]
        lines += ["|---|---|---|---|---|---|"]
        lines += [_line(row.name, [each for each in found if each.row.name == row.name]) for row in rows]
        lines += [""]
    return "\n".join([*lines, "## Side by side", "", *peers]) + "\n"


def _line(name: str, own: list[Verdict]) -> str:
    row = own[0].row
    ends = ", ".join(f"{each.numbers}" if each.holds else f"**not in {each.numbers}**" for each in own)
    claims = ", ".join(claim.word for claim in row.holds)
    cells = (name, row.hard, row.given, claims, row.reference, ends)
    return f"| {' | '.join(cell.replace('|', '∣') for cell in cells)} |"


def side_by_side() -> Iterator[str]:
    """Who is finite, and how far off: the value, and the worst of its slopes by n, k and alpha."""
    yield (
        "F · D · G / (4 n·v) of a GGX metal in float32: by `shaders`, by Mitsuba's `roughconductor` (`llvm_ad_rgb`,"
        " forward derivatives), and by the textbook's formulas in torch (PBRT's conductor, D and G1 by cosines)."
        " Relative error of the value, and the largest error of its slopes by n, k and alpha over the largest slope,"
        " against the formulas at 50 digits; what is below a millionth of 1/α² counts by that. Right is within"
        f" {RIGHT:g} in both."
    )
    yield ""
    yield "| place | ours: value, slopes | Mitsuba | textbook |"
    yield "|---|---|---|---|"
    for place, told in zip(PLACES, compared(), strict=True):
        yield f"| {place.name} | {' | '.join(str(each) for each in told)} |"
