"""The side-by-side table: nowhere is a peer right and we are not; and the page holds what was measured."""

from __future__ import annotations

import math

import pytest
import torch

from fit_material.fitter.selftest.experiments.row import Numbers
from fit_material.fitter.selftest.table import ROWS, TOPICS, Verdict
from fit_material.renderer.mitsuba.conversion import variant_here
from tests.bench import peers
from tests.bench.hard_cases import MEANINGS, page_text
from tests.bench.peers import PLACES, Judged, Place


def test_we_are_right_wherever_a_peer_is():
    for place in PLACES:
        exact = peers.reference(place)
        assert peers._judged(peers.by_us(place), exact, place).right, place.name


@pytest.mark.skipif(variant_here() != "llvm_ad_rgb", reason="needs LLVM's library")
def test_mitsubas_answer_is_near_the_reference_where_nothing_is_hard():
    """The reference itself is checked so, by a program of others."""
    for place in PLACES[:2]:
        assert peers._judged(peers.by_mitsuba(place), peers.reference(place), place).right


def test_the_textbook_fails_where_it_cancels():
    silver = Place("silver", 1e-4, 4.0, 0.2, 0.8, 0.8)
    assert not peers._judged(peers.by_textbook(silver), peers.reference(silver), silver).right


def test_what_is_not_finite_is_said():
    assert str(Judged(1e-7, math.nan)) == "1e-07, **not finite**"
    assert not Judged(math.nan, 0.0).right


def test_the_page_names_every_row_and_what_does_not_hold():
    found = [
        Verdict(topic, row, Numbers(torch.float64), ("finite: is nan",) if row.name == "silver" else (), 0.0)
        for topic, rows in TOPICS.items()
        for row in rows
    ]
    page = page_text(found, ["| peers |"], "commit 1", "command")
    lines = {line.split(" | ")[0].removeprefix("| "): line for line in page.splitlines() if line.startswith("| ")}
    assert all(row.name in lines for rows in TOPICS.values() for row in rows)
    assert "**not in float64**" in lines["silver"]
    assert f"{len(found) - 1} of {len(found)} runs" in page
    assert page.rstrip().endswith("| peers |")


def test_every_word_of_the_table_is_explained():
    assert {claim.word for row in ROWS for claim in row.holds} == MEANINGS.keys()
