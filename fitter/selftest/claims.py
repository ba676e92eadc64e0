"""Claims of the table of hard cases."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.selftest.experiments.row import EVERYWHERE, Claim, Formula, Numbers
from fit_material.renderer.errors.input_error import InputError

STEP = 1e-3  # of a finite difference, in scales of the input: five places then err by 1e-12 of the fifth derivative
SLOPE = 1e-4  # relative error of a derivative
FLAT = 1e-6  # of the largest value per scale, below which a slope is none
DOUBLE = Numbers(torch.float64)

_CENTRAL = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))
_FORWARD = ((0, -25 / 12), (1, 4.0), (2, -3.0), (3, 4 / 3), (4, -1 / 4))  # [Abramowitz & Stegun 1964, table 25.2]


def _first(broken: Bool[Tensor, " p"], formula: Formula, numbers: Numbers, found: Tensor, expected: str) -> str | None:
    """The sentence about the first place at which something is broken."""
    if not broken.any():
        return None
    at = int(broken.nonzero()[0])
    place = ", ".join(f"{name} = {values[at]:.9g}" for name, values in formula.inputs(numbers).items())
    return f"is {found[at]:.9g} at {place}, expected {expected}"


def _finite(formula: Formula, numbers: Numbers) -> str | None:
    value, slopes = formula.with_slopes(numbers)
    told = {"value": value, **{f"slope by {name}": slope for name, slope in slopes.items()}}
    for name, found in told.items():
        sentence = _first(~found.isfinite(), formula, numbers, found, f"a finite {name}")
        if sentence:
            return sentence
    return None


FINITE = Claim("finite", _finite)
"""Value and derivative by every input are finite."""


def between(low: float, high: float, roundings: float = 0) -> Claim:
    """The value lies in an interval, up to so many roundings."""

    def broken(formula: Formula, numbers: Numbers) -> str | None:
        value, slack = formula.value(numbers), roundings * numbers.eps
        outside = ~((value >= low - slack) & (value <= high + slack))
        return _first(outside, formula, numbers, value, f"{low:g} to {high:g}")

    return Claim("bounded", broken)


def near(
    reference: Callable[..., float], roundings: float, relative: bool = True, floor: float = 0.0, off: float = 0.0
) -> Claim:
    """The value is a reference's, up to so many roundings of it, or of 1, times its own conditioning.

    A function f that takes m roundings, each of one part in 1/ε, of its inputs and of numbers between, errs by

        m ε (|f| + Σ |x_i ∂f/∂x_i|)        [Higham 2002, §1.6]

    to first order, if nothing in it cancels that does not cancel in f itself: that is the claim.

    Args:
        reference: of floats by name.
        roundings: m.
        relative: whether |f| stands there, else 1.
        floor: absolute error that is always allowed: that of a reference that is itself a quadrature, or underflow.
        off: relative error of a reference that is itself an approximation.
    """

    def broken(formula: Formula, numbers: Numbers) -> str | None:
        exact = formula.exactly(numbers)
        found = formula.value(numbers).double().cpu()
        inputs = {name: values.tolist() for name, values in exact.inputs(DOUBLE).items()}
        rows = [dict(zip(inputs, at, strict=True)) for at in zip(*inputs.values(), strict=True)]
        expected = torch.tensor([reference(**row) for row in rows], dtype=torch.float64)
        allowed = roundings * numbers.eps * (_conditioning(exact) + (expected.abs() if relative else 1.0))
        wrong = ~((found - expected).abs() <= allowed + floor + off * expected.abs())
        at = int(wrong.int().argmax())
        return _first(wrong, formula, numbers, found, f"{expected[at]:.9g} ± {allowed[at]:.2g}")

    return Claim("near", broken)


def float32(roundings: float) -> Claim:
    """The value in these numbers is that in float64, within the bound of `near`."""

    def broken(formula: Formula, numbers: Numbers) -> str | None:
        exact = formula.exactly(numbers)
        found, expected = formula.value(numbers).double().cpu(), exact.value(DOUBLE)
        allowed = roundings * numbers.eps * (_conditioning(exact) + expected.abs())
        wrong = ~((found - expected).abs() <= allowed + torch.finfo(numbers.dtype).tiny)
        at = int(wrong.int().argmax())
        return _first(wrong, formula, numbers, found, f"{expected[at]:.9g} ± {allowed[at]:.2g}")

    return Claim("float32", broken)


def _conditioning(formula: Formula) -> Float[Tensor, " p"]:
    """Σ |x_i ∂f/∂x_i|, float64."""
    slopes = formula.with_slopes(DOUBLE)[1]
    terms = [(values * slopes[name]).abs() for name, values in formula.inputs(DOUBLE).items()]
    return torch.stack(terms).sum(0).nan_to_num(0.0, 0.0, 0.0)


def gradient(*names: str) -> Claim:
    """The derivative by these inputs, else by all, is that of finite differences in float64 [steps: `STEP`]."""

    def broken(formula: Formula, numbers: Numbers) -> str | None:
        exact = formula.exactly(numbers)
        value, slopes = formula.with_slopes(numbers)
        for name in names or formula.places:
            expected, scale = _differences(exact, name)
            found = slopes[name].double().cpu()
            allowed = SLOPE * expected.abs() + FLAT * float(value.abs().max()) / scale
            wrong = ~((found - expected).abs() <= allowed)
            told = f"a slope by {name} of {expected[int(wrong.int().argmax())]:.9g}"
            sentence = _first(wrong, formula, numbers, found, told)
            if sentence:
                return sentence
        return None

    return Claim("gradient", broken)


def _differences(formula: Formula, name: str) -> tuple[Float[Tensor, " p"], Float[Tensor, " p"]]:
    """Derivative by one input from five places beside each other, inside of its domain; and the input's scale."""
    inputs = formula.inputs(DOUBLE)
    at, (low, high) = inputs[name], formula.domain.get(name, EVERYWHERE)
    usual = at.abs().clamp_min(1.0)
    scale = torch.full_like(at, formula.scale[name]) if name in formula.scale else usual
    step = STEP * scale

    def slope(rule: tuple[tuple[int, float], ...], step: Tensor) -> Tensor:
        values = [weight * formula.function(**{**inputs, name: at + place * step}) for place, weight in rule]
        return torch.stack(values).sum(0) / step

    at_low, at_high = at - 2 * step < low, at + 2 * step > high
    inwards = slope(_FORWARD, torch.where(at_high, -step, step))
    return torch.where(at_low | at_high, inwards, slope(_CENTRAL, step)), scale


def rising(name: str, sign: int = 1) -> Claim:
    """The value does not fall (rise, for the sign -1) from place to place as an input ascends."""

    def broken(formula: Formula, numbers: Numbers) -> str | None:
        value = formula.value(numbers)
        wrong = torch.cat([torch.zeros_like(value[:1], dtype=torch.bool), sign * value.diff() < -4 * numbers.eps])
        return _first(wrong, formula, numbers, value, f"{'no less' if sign > 0 else 'no more'} than before by {name}")

    return Claim("monotone", broken)


def sentence(word: str) -> Claim:
    """An experiment that returns the fault in a sentence."""
    return Claim(word, lambda found, numbers: found)


def within(bound: Callable[[Numbers], float], word: str = "near") -> Claim:
    """An experiment that returned an error keeps it within a bound, which may depend on the numbers."""

    def broken(error: float, numbers: Numbers) -> str | None:
        most = bound(numbers)
        return None if error <= most else f"is off by {error:.3g}, expected at most {most:.3g}"

    return Claim(word, broken)


def refused(words: str) -> Claim:
    """An experiment that ended in one sentence for the user, with these words in it."""

    def broken(found: Any, numbers: Numbers) -> str | None:
        if not isinstance(found, InputError):
            return f"was taken, expected a refusal with the words {words!r}"
        return None if words in str(found) else f"said {str(found)!r}, expected the words {words!r}"

    return Claim("refused", broken)
