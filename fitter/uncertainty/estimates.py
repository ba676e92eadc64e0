"""The numbers of a fit, each with what is known of its error."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.estimation.viewer_roughness import ViewerRoughness
from fit_material.fitter.forward.pixel_model import ViewerPixels
from fit_material.fitter.least_squares.covariance import TWO_SIDED_95, Spread, standard_errors
from fit_material.fitter.options.fidelity import BLUR_RANGE, MICROFACET_RANGE
from fit_material.fitter.result.schema import CHANNELS
from fit_material.fitter.uncertainty.profile_likelihood import intervals
from fit_material.shaders.materials.types import material_type
from fit_material.shaders.optics import fresnel

RESOLVED = 1e-12  # of a value: float64 says nothing of smaller errors; a free number far beyond its domain has such
COVERED = 0.9  # of a domain: an interval that leaves out no more says what was known without any photograph

QUANTITIES: Mapping[str, Mapping[str, Callable[[Any], Tensor]]] = {
    "metal": {
        "n": lambda metal: metal.n,
        "k": lambda metal: metal.k,
        "f0": lambda metal: metal.f0,
        "roughness": lambda metal: metal.roughness[None],
    },
    "glossy": {
        "color": lambda glossy: glossy.color,
        "reflectance": lambda glossy: glossy.reflectance,
        "f0": lambda glossy: glossy.reflectance,
        "roughness": lambda glossy: glossy.roughness[None],
    },
    "matte": {
        "color": lambda matte: matte.color,
        "reflectance": lambda matte: matte.reflectance,
    },
}
"""What is reported of each type of material; `roughness` is alpha or ρ, as the lobe of the fit has it."""


def name_of(fit: Fit, key: str, channel: int | None) -> str:
    """One of `QUANTITIES` in words: "n of red", "alpha"; without a channel where it has none."""
    key = parameter_of(fit, key)
    return key if channel is None else f"{key} of {CHANNELS[channel]}"


def parameter_of(fit: Fit, key: str) -> str:
    """The key of one of `QUANTITIES` in `result.json`."""
    return "alpha" if key == "roughness" and not isinstance(fit.residuals.model, ViewerPixels) else key


@dataclass(frozen=True)
class Measured:
    """A number with its standard error and 95 % interval, None where it has none."""

    value: float
    stderr: float | None = None
    interval: tuple[float, float] | None = None

    def within(self, low: float, high: float) -> Measured:
        """The number, known to lie in [low, high]: without an error, and with that interval, where no more is known.

        That is so where its own interval covers the domain but for a tenth, or its standard error all of it.
        """
        value = min(max(self.value, low), high)
        if self.stderr is None or self.interval is None:
            return Measured(value, None, (low, high))
        inside = max(self.interval[0], low), min(self.interval[1], high)
        if inside[1] - inside[0] >= COVERED * (high - low) or self.stderr >= high - low:
            return Measured(value, None, (low, high))
        return Measured(value, self.stderr, (min(inside[0], value), max(inside[1], value)))


def measured(fit: Fit, spread: Spread, key: str) -> list[Measured]:
    """One of `QUANTITIES` of a fit, per channel, with error and interval from the covariance of its free vector.

    A number that no free number moves, because these ran to the ends of their domains, has neither.
    """
    coordinates, of_material = fit.residuals.coordinates, QUANTITIES[fit.material.type][key]

    def quantity(x: Tensor) -> Tensor:
        return of_material(coordinates.material(x))

    errors = standard_errors(quantity, fit.x, spread)
    lows, highs = intervals(fit, spread, quantity)
    rows = zip(quantity(fit.x).tolist(), errors.tolist(), lows.tolist(), highs.tolist(), strict=True)
    found = [
        Measured(value, error, (low, high))
        if error > RESOLVED * abs(value) and math.isfinite(error + low + high)
        else Measured(value)
        for value, error, low, high in rows
    ]
    if key == "roughness":
        found = [roughness_of(fit, each) for each in found]
    return [each.within(*domain) for each, domain in zip(found, _domains(fit, key), strict=True)]


def roughness_of(fit: Fit, number: Measured) -> Measured:
    """A roughness as its free number tells it, which knows nothing beyond the light table's span.

    Where the picture does not change with it, its interval is that of all that explain the photographs as well. One
    that fills the span, where it had to end, has a symmetric one instead.
    """
    if fit.alike is not None:
        low, high = fit.alike.span
        return Measured(number.value, (high - low) / math.sqrt(12), (min(low, number.value), max(high, number.value)))
    span = fit.residuals.coordinates.roughness
    assert span is not None
    if number.stderr is None or number.within(span.low, span.high).stderr is not None:
        return number
    half = TWO_SIDED_95 * number.stderr
    return replace(number, interval=(number.value - half, number.value + half))


def _domains(fit: Fit, key: str) -> list[tuple[float, float]]:
    """Where a number lies without any photograph: n and k on the circle of their F0."""
    material, model = fit.material, fit.residuals.model
    if key == "roughness":
        return [BLUR_RANGE if isinstance(model, ViewerPixels) else MICROFACET_RANGE]
    if key in ("n", "k"):
        assert material.f0 is not None
        limits = fresnel.index_limit(material.f0).tolist()
        return [(1 / limit, limit) if key == "n" else (0.0, (limit - 1 / limit) / 2) for limit in limits]
    return [(0.0, 1.0)] * 3


def paired(n: Sequence[Measured], k: Sequence[Measured], fit: Fit) -> dict[str, list[Measured]]:
    """n and k, of which neither says more than its domain where the other does not: both run round one circle."""
    told = [a.stderr is not None and b.stderr is not None for a, b in zip(n, k, strict=True)]
    whole = {key: unseen(fit, key) for key in ("n", "k")}
    return {
        key: [own if known else bare for own, known, bare in zip(numbers, told, whole[key], strict=True)]
        for key, numbers in (("n", n), ("k", k))
    }


def unseen(fit: Fit, key: str) -> list[Measured]:
    """The same numbers of a model that cannot see them: the domain is all that is known."""
    values = QUANTITIES[fit.material.type][key](fit.material).tolist()
    return [Measured(value).within(*domain) for value, domain in zip(values, _domains(fit, key), strict=True)]


def of_viewer(rho: ViewerRoughness) -> Measured:
    """The viewer's roughness."""
    if not math.isfinite(rho.stderr):
        return Measured(rho.rho).within(*BLUR_RANGE)
    half = TWO_SIDED_95 * rho.stderr
    return Measured(rho.rho, rho.stderr, (rho.rho - half, rho.rho + half)).within(*BLUR_RANGE)


def rule(kind: str, key: str) -> str:
    """By which parameter's rule a number counts as determined: 0.02 says much of a metal's F0, and nothing of 0.04."""
    return material_type(kind).same_as.get(key, key)
