"""Sentences about what is not determined, and numbers of which nothing but their domain is known."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.fitted.determinability import Seen, on_the_prior, verdicts
from fit_material.fitter.metal_prior.borrowed import Borrowed, TooFar
from fit_material.fitter.result.schema import Determined, FittedMaterial, FromPrior, Intervals, Share
from fit_material.fitter.uncertainty.estimates import Measured

GOOD = Seen(pixels=4000, grazing=900, steepest=88.2, noise=(0.011, 0.012, 0.013), f0_only=False)
RED_OPEN = Determined(n=(True, True, True), k=(False, True, True), f0=(True, True, True), alpha=True)


def material(f0=0.7, **changes) -> FittedMaterial:
    values = {
        "name": "ball",
        "type": "metal",
        "n": (0.2, 0.4, 1.4),
        "k": (3.8, 2.3, 1.8),
        "f0": (f0, 0.7, 0.4),
        "alpha": 0.2,
        "roughness": 0.6,
        "determined": RED_OPEN,
        "interval95": Intervals(k=((2.9, 5.1), (2.2, 2.4), (1.7, 1.9)), n=((0.1, 0.3), (0.3, 0.5), (1.3, 1.5))),
    }
    return FittedMaterial(**{**values, **changes})


@pytest.mark.parametrize(
    ("f0", "seen", "reason"),
    [
        (0.7, replace(GOOD, steepest=69.3), "no pixel beyond 70°"),
        (0.7, replace(GOOD, grazing=12), "only 12 pixels beyond 60°"),
        (0.7, GOOD, "photographs and fit differ by 1.1 % a pixel beyond 60°"),
        (
            0.96,
            GOOD,
            "F0 is near 1, where the curve hardly shows n and k, and photographs and fit differ by 1.1 % a pixel"
            " beyond 60°",
        ),
        (0.7, replace(GOOD, f0_only=True), "the reflectance fitted with sees F0 only"),
    ],
)
def test_the_reason_is_the_fits_own(f0, seen, reason):
    assert verdicts(material(f0), seen) == [f"By these photographs k of red lies anywhere in 2.9…5.1: {reason}."]


def test_numbers_with_one_reason_share_a_sentence():
    both = RED_OPEN.model_copy(update={"n": (False, True, True)})
    (told,) = verdicts(material(determined=both), replace(GOOD, steepest=50.0))
    expected = "By these photographs n of red lies anywhere in 0.1…0.3 and k of red in 2.9…5.1: no pixel beyond 50°."
    assert told == expected


def test_alpha_has_no_channel_and_no_angle():
    open_alpha = Determined(alpha=False)
    told = verdicts(material(determined=open_alpha, interval95=Intervals(alpha=(0.005, 0.2))), GOOD)
    expected = "By these photographs alpha lies anywhere in 0.005…0.2: photographs and fit differ by 1.3 % a pixel."
    assert told == [expected]


def test_a_roughness_that_no_light_shows_has_a_reason_of_its_own():
    open_alpha = Determined(alpha=False)
    found = material(determined=open_alpha, interval95=Intervals(alpha=(0.005, 1.2)))
    expected = (
        "By these photographs alpha lies anywhere in 0.005…1.2: in this light the picture changes with it by no more"
        " than its own error."
    )
    assert verdicts(found, replace(GOOD, alike=True)) == [expected]


def test_nothing_is_said_where_all_is_determined():
    all_known = RED_OPEN.model_copy(update={"k": (True, True, True)})
    assert verdicts(material(determined=all_known), GOOD) == []


def test_few_pixels_are_told():
    told = verdicts(
        material(determined=Determined(f0=(False, True, True)), interval95=Intervals()), replace(GOOD, pixels=7)
    )
    assert told == ["By these photographs f0 of red lies anywhere in its domain: only 7 pixels show it."]


def prior(**changes) -> FromPrior:
    values = {"n": (True, False, True), "k": (True, False, False)}
    metals = (Share(name="gold", share=0.83), Share(name="silver", share=0.12))
    return FromPrior(**{**values, "metals": metals, "photographs95": Intervals(k=((1, 9), (2, 3), (1, 2)))} | changes)


def test_the_verdict_tells_the_photographs_interval_and_not_the_priors():
    (told,) = verdicts(material(from_prior=prior()), replace(GOOD, steepest=69.3))
    assert told == "By these photographs k of red lies anywhere in 1…9: no pixel beyond 70°."


def test_what_comes_from_the_catalogue_is_said():
    three = (Measured(1.0), Measured(1.0), Measured(1.0))
    borrowed = Borrowed((("gold", 0.83),), three, three)
    expected = (
        "n and k of red and n of blue come from the catalogue's gold (83%) and silver (12%), not from the photographs."
    )
    assert on_the_prior(material(from_prior=prior()), borrowed) == [expected]
    assert on_the_prior(material(), borrowed) == []
    assert on_the_prior(material(), None) == []


def test_a_refused_prior_is_said():
    expected = "The catalogue is no prior here: its nearest metal, brass, is 3.4 σ away."
    assert on_the_prior(material(), TooFar("brass", 3.412)) == [expected]


@pytest.mark.parametrize(
    ("number", "expected"),
    [
        (Measured(0.5, 4302.0, (0.0, 1.0)), Measured(0.5, None, (0.0, 1.0))),
        (Measured(0.5, 0.4, (0.02, 0.99)), Measured(0.5, None, (0.0, 1.0))),
        (Measured(0.5, 0.1, (0.3, 0.7)), Measured(0.5, 0.1, (0.3, 0.7))),
        (Measured(1.2, 0.1, (0.9, 1.5)), Measured(1.0, 0.1, (0.9, 1.0))),
        (Measured(0.5), Measured(0.5, None, (0.0, 1.0))),
    ],
)
def test_an_interval_that_covers_its_domain_is_the_domain(number, expected):
    assert number.within(0.0, 1.0) == expected


@given(st.floats(-2, 3), st.floats(0, 1e6), st.floats(0, 5), st.floats(0, 5))
def test_a_number_stays_in_its_domain_and_in_its_interval(value, error, down, up):
    found = Measured(value, error, (value - down, value + up)).within(0.0, 1.0)
    assert found.interval is not None
    assert 0 <= found.interval[0] <= found.value <= found.interval[1] <= 1
    assert found.stderr is None or found.stderr < 1
