"""Findings that a coarse fit brings: light rotated, mirrored or upside down, encodings and exposures that are wrong.

A fault is reported where without it the photographs are explained `DECISIVE` times better. Wrong light leaves
differences of 10 % to 100 %, right light 3 % to 9 %, of which most is the coarse fit's own error, which is alike under
all hypotheses: so nothing that is right is beaten by a factor. Light that looks alike from all sides beats nothing
either: then nothing is reported.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from fit_material.fitter.input_checks.finding import Finding, percent
from fit_material.fitter.input_checks.hypotheses import Hypothesis, HypothesisTest, Trial
from fit_material.fitter.input_checks.orientation import orientations, upright
from fit_material.renderer.materials.catalogue import DARKEST_MATTE

EXPLAINED = 0.05  # misfit at which no better orientation is searched for
SUSPICIOUS = 0.1  # misfit from which all orientations are tried, and not only single slips
DECISIVE = 1.6
LEAST = 0.03  # by which a misfit has to fall, whatever the factor
AS_GOOD = 1.1  # times the least misfit, at which the simpler of two orientations is reported
GAIN = 1.2  # factor by which an exposure is wrong


@dataclass(frozen=True)
class Step:
    """A supposition that was put in the place of another because it explains more."""

    before: Hypothesis
    after: Hypothesis
    first: Trial
    last: Trial

    @property
    def told(self) -> str:
        return f"the coarse fit's residual falls from {percent(self.first.misfit)} to {percent(self.last.misfit)}"


@dataclass(frozen=True)
class Named:
    """How findings call a photograph: its place in the scene file and its file's name."""

    index: int
    name: str
    exposure: float | None

    @property
    def where(self) -> str:
        return f"photographs[{self.index}] ({self.name})"


def steps(tribunal: HypothesisTest, start: Hypothesis) -> list[Step]:
    """What has to be supposed to explain the photographs: one thing after another, the most telling first."""
    found: list[Step] = []
    now, trial = start, tribunal.trial(start)
    while len(found) < 3:
        tried = [(each, tribunal.trial(each)) for each in _others(tribunal, now, trial.misfit)]
        best = _simplest(tried)
        if best is None or not _is_decisive(trial.misfit, best[1].misfit):
            break
        found.append(Step(now, best[0], trial, best[1]))
        now, trial = best
    return found


def _is_decisive(before: float, after: float) -> bool:
    return before > DECISIVE * after and before - after > LEAST


def _simplest(tried: Sequence[tuple[Hypothesis, Trial]]) -> tuple[Hypothesis, Trial] | None:
    """The first that is about as good as the best."""
    least = min((trial.misfit for _, trial in tried), default=math.inf)
    return next((each for each in tried if each[1].misfit <= AS_GOOD * least), None)


def _others(tribunal: HypothesisTest, now: Hypothesis, misfit: float) -> Iterator[Hypothesis]:
    """What else may be supposed, likely things first."""
    if misfit <= EXPLAINED:
        return
    count = len(tribunal.declared_linear)
    if now.orientation.changes == 0:
        every = orientations()[1:]
        single = [each for each in every if each.changes == 1]
        tribunal.prepare(single)
        least = min(tribunal.misfit(replace(now, orientation=each)) for each in single)
        suspicious = misfit > SUSPICIOUS or _is_decisive(misfit, least)
        tribunal.prepare(every if suspicious else single)
        yield from (replace(now, orientation=each) for each in (every if suspicious else single))
    if not now.recoded:
        linear = frozenset(tribunal.declared_linear.nonzero()[:, 0].tolist())
        coded = frozenset(range(count)) - linear
        yield from (replace(now, recoded=each) for each in (linear, coded) if each)
        if count > 1:
            yield from (replace(now, recoded=frozenset({index})) for index in range(count))
    if now.gains == "as said":
        if count > 1:
            yield replace(now, gains="each")
        yield replace(now, gains="all")


def findings(found: Sequence[Step], photographs: Sequence[Named], tribunal: HypothesisTest) -> list[Finding]:
    """The steps in words."""
    told: list[Finding] = []
    for step in found:
        if step.after.orientation != step.before.orientation:
            told.append(_orientation(step, tribunal.light.environment.rotation))
        elif step.after.recoded != step.before.recoded:
            told.append(_encoding(step, photographs, tribunal))
        else:
            told += _exposures(step, photographs)
    return told


def darkness_findings(tribunal: HypothesisTest) -> list[Finding]:
    """Whether the photographs are darker than any material; of those that are fitted exposures are declared."""
    brightness = tribunal.brightness
    if brightness >= DARKEST_MATTE:
        return []
    value = f"{brightness:.2g} times as bright as a white matte object in this light, darker than any material"
    remedy = 'give exposures in the environment\'s own units, correct environment.scale, or set it to "fit"'
    return [Finding("exposure", "photographs", value, remedy)]


def _orientation(step: Step, rotation: float) -> Finding:
    to = step.after.orientation
    set_rotation = f"set rotation = {(rotation + to.turn) % 360:g}"
    turned = f"turned by {to.turn}°" if to.turn else ""
    mirrored = "mirrored left to right" if to.mirrored else ""
    value = f"{' and '.join(filter(None, (mirrored, turned)))}: {step.told}"
    mirror = "mirror the map (reverse its columns)"
    if to.up != "+Y":
        kind, where = "up-axis", "environment against mesh and cameras"
        value = f"with {to.up} of the scene up in the map{', ' if mirrored or turned else ''}{value}"
        remedy = f"turn mesh and cameras so that their {to.up} becomes +Y: {turning(to.up)}"
        remedy += f", {mirror}" if to.mirrored else ""
        return Finding(kind, where, value, remedy + (f", {set_rotation}" if to.turn else ""))
    if to.mirrored:
        return Finding("environment-mirrored", "environment.map", value, f"{mirror} and {set_rotation}")
    return Finding("environment-rotation", "environment.rotation", value, set_rotation)


def turning(up: str) -> str:
    """Images of x, y, z where an axis is rotated to +Y."""
    names, rows = ("x", "y", "z"), upright(up).int().tolist()
    becomes = [("-" if sum(row) < 0 else "") + names[[abs(v) for v in row].index(1)] for row in rows]
    return f"(x, y, z) → ({', '.join(becomes)})"


def _encoding(step: Step, photographs: Sequence[Named], tribunal: HypothesisTest) -> Finding:
    chosen = sorted(step.after.recoded)
    linear = bool(tribunal.declared_linear[chosen[0]])
    is_, fits = ("linear", "sRGB, already tone-mapped") if linear else ("sRGB", "linear")
    where = "photographs" if len(chosen) == len(photographs) > 1 else ", ".join(photographs[i].where for i in chosen)
    value = f"declared {is_}, but the pixels fit as {fits}: {step.told}"
    word = "srgb" if linear else "linear"
    return Finding("encoding", where, value, f'set encoding = "{word}", or use files as the camera recorded them')


def _exposures(step: Step, photographs: Sequence[Named]) -> list[Finding]:
    gains = step.last.gains.tolist()
    if step.after.gains == "all":
        value = f"all photographs are {gains[0]:.2g} times as bright as any material in this light: {step.told}"
        remedy = f"multiply environment.scale, or every exposure, by {gains[0]:.3g}"
        return [Finding("exposure", "photographs", value, remedy)]
    told = []
    for photograph, gain in zip(photographs, gains, strict=True):
        if max(gain, 1 / gain) >= GAIN:
            value = f"{gain:.2g} times as bright as by the other photographs: {step.told}"
            said = photograph.exposure
            remedy = "correct its exposure" if said is None else f"set exposure = {said * gain:.3g}"
            told.append(Finding("exposure", photograph.where, value, remedy))
    return told
