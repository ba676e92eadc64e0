"""What the photographs do not determine, and why, in sentences for a person."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.least_squares.noise import darkest
from fit_material.fitter.materials.coordinates import Coordinates
from fit_material.fitter.metal_prior.borrowed import Borrowed, TooFar
from fit_material.fitter.observations.pixel_selection import Observations
from fit_material.fitter.result.formatting import HEADLINE
from fit_material.fitter.result.schema import CHANNELS, FittedMaterial
from fit_material.shaders.materials.quantities import ALPHA, INDEX

GRAZING = 60.0  # degrees: from there on metals of equal F0 differ
STEEP = 75.0  # degrees: photographs that reach no further hold little of that difference
FEW = 30  # pixels: scatter and angles of fewer determine little
ONE_SIGMA = 0.6827  # share of normal deviations within one standard deviation
BRIGHT = 0.9  # F0 of red gold, silver, aluminium: their curves have next to no room above


@dataclass(frozen=True)
class Seen:
    """What a fit had to go by.

    Attributes:
        pixels: how many.
        grazing: how many of them beyond 60°.
        steepest: angle between view and normal, degrees, that none of them exceeds.
        noise: scatter of photograph over fit among the pixels beyond 60°, or among all where these are few; red, green,
            blue.
        f0_only: whether the reflectance was one that n and k enter through F0 alone.
        guessed: what was fitted beside the material and is not determined, in words.
        alike: whether the picture is the same for all roughnesses near the one found, but for its own error.
    """

    pixels: int
    grazing: int
    steepest: float
    noise: tuple[float, float, float]
    f0_only: bool
    guessed: tuple[str, ...] = ()
    alike: bool = False


def seen_by(fit: Fit, observed: Observations, guessed: tuple[str, ...] = ()) -> Seen:
    """What the photographs offered to the fit, but for bounds."""
    observed, picture = observed.measured, fit.picture[fit.residuals.is_measured]
    cosine = observed.surface.n_dot_v.double().flatten(1).mean(1)
    angle = torch.rad2deg(torch.acos(cosine.clamp(0, 1)))
    beyond = angle > GRAZING
    told = beyond if int(beyond.sum()) >= FEW else torch.ones_like(beyond)
    level = torch.maximum(picture, darkest(observed.radiance))  # of a fit that is black nothing is a share
    ratio = ((observed.radiance - picture) / level)[told]
    red, green, blue = ratio.abs().quantile(ONE_SIGMA, 0).tolist()
    f0_only = sees_f0_only(fit.residuals.coordinates)
    alike = fit.alike is not None
    return Seen(len(angle), int(beyond.sum()), float(angle.max()), (red, green, blue), f0_only, guessed, alike)


def sees_f0_only(coordinates: Coordinates) -> bool:
    """Whether a metal was fitted by a reflectance that n and k enter through F0 alone [MODEL.md 1]."""
    return coordinates.sees_f0_only


def verdicts(material: FittedMaterial, seen: Seen) -> list[str]:
    """A sentence for each reason why numbers are not determined: "k of red lies anywhere in 2.9…5.1: no pixel …"."""
    by_reason: dict[str, list[str]] = {}
    for key in HEADLINE:
        for channel, interval in _open(material, key):
            name = f"{key} of {CHANNELS[channel]}" if channel is not None else key
            reason, span = _reason(key, channel, material, seen), _range(interval) if interval else "its domain"
            told = by_reason.setdefault(reason, [])
            told.append(f"{name} in {span}" if told else f"{name} lies anywhere in {span}")
    return [f"By these photographs {_listed(told)}: {reason}." for reason, told in by_reason.items()]


def on_the_prior(material: FittedMaterial, borrowed: Borrowed | TooFar | None) -> list[str]:
    """Which numbers come from known metals, or why none do."""
    refused = borrowed if isinstance(borrowed, TooFar) else borrowed.refused if borrowed else None
    sentences = []
    if refused is not None:
        sentences.append(
            f"The catalogue is no prior here: its nearest metal, {refused.nearest}, is {refused.distance:.2g} σ away."
        )
    taken = material.from_prior
    if taken is not None:
        metals = _listed([f"{metal.name} ({metal.share:.0%})".replace(" (100%)", "") for metal in taken.metals])
        numbers = _listed([f"{keys} of {_listed(names)}" for keys, names in _grouped(taken.n, taken.k).items()])
        sentences.append(f"{numbers} come from the catalogue's {metals}, not from the photographs.")
    return sentences


def _grouped(n: tuple[bool, ...], k: tuple[bool, ...]) -> dict[str, list[str]]:
    """Channels by which of their two numbers are marked."""
    groups: dict[str, list[str]] = {}
    for channel, marks in zip(CHANNELS, zip(n, k, strict=True), strict=True):
        keys = " and ".join(key for key, mark in zip(INDEX, marks, strict=True) if mark)
        if keys:
            groups.setdefault(keys, []).append(channel)
    return groups


def _open(material: FittedMaterial, key: str) -> list[tuple[int | None, tuple[float, float] | None]]:
    """Channels in which a number is not determined, None where it has none, with the photographs' own interval."""
    known = getattr(material.determined, key)
    own = material.from_prior.photographs95 if material.from_prior and key in INDEX else material.interval95
    intervals = getattr(own, key)
    if isinstance(known, tuple):
        return [(i, intervals[i] if intervals else None) for i, each in enumerate(known) if each is False]
    return [(None, intervals)] if known is False and intervals is not None else []


def _reason(key: str, channel: int | None, material: FittedMaterial, seen: Seen) -> str:
    """The first that applies."""
    if key in INDEX and channel is not None and (seen.f0_only or not seen.guessed):
        return _reason_of_index(channel, material, seen)
    if key != ALPHA.name and seen.guessed:
        return f"{_listed(list(seen.guessed))} not known, the object may as well reflect more or less light"
    if key == ALPHA.name and seen.alike:
        return "in this light the picture changes with it by no more than its own error"
    if seen.pixels < FEW:
        return f"only {seen.pixels} pixels show it"
    return _noise(max(seen.noise) if channel is None else seen.noise[channel])


def _reason_of_index(channel: int, material: FittedMaterial, seen: Seen) -> str:
    """Why n and k of a channel are not separable; they differ near grazing angles only."""
    if seen.f0_only:
        return "the reflectance fitted with sees F0 only"
    if seen.steepest < STEEP:
        return f"no pixel beyond {math.ceil(seen.steepest)}°"
    if seen.grazing < FEW:
        return f"only {seen.grazing} pixels beyond {GRAZING:g}°"
    noise = f"{_noise(seen.noise[channel])} beyond {GRAZING:g}°"
    if material.f0 is not None and material.f0[channel] > BRIGHT:
        return f"F0 is near 1, where the curve hardly shows n and k, and {noise}"
    return noise


def _noise(scattered: float) -> str:
    return f"photographs and fit differ by {100 * scattered:.2g} % a pixel"


def _listed(words: list[str]) -> str:
    """Words as in "a", "a and b", "a, b and c"."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _range(interval: tuple[float, float]) -> str:
    return f"{interval[0]:.3g}…{interval[1]:.3g}"
