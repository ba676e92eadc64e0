"""A fit in the words and numbers of `result.json`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from fitter.choice import DECISIVE, Choice
from fitter.result import (
    Determined,
    FittedMaterial,
    Intervals,
    Nearest,
    StandardErrors,
    Status,
)
from fitter.search import Fit
from fitter.uncertainty import TWO_SIDED_95, Spread, intervals95, is_determined, standard_errors
from fitter.viewer_roughness import RHO_PER_ALPHA, ViewerRoughness

CHANNELS = ("red", "green", "blue")
NO_METAL_BEYOND = 0.995  # silver, the most reflective, has F0 = 0.988

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
        "color": lambda matte: matte.color * matte.reflectance.clamp_min(1),
        "reflectance": lambda matte: matte.reflectance,
    },
}
"""What is reported of each type of material; `roughness` is alpha or ρ, as the lobe of the fit has it."""

ESSENTIAL = {"metal": ("f0", "alpha"), "glossy": ("color", "f0", "alpha"), "matte": ("color",)}
"""What must be determined for a fit to have a usable material."""


def fitted_material(
    name: str, fit: Fit, spread: Spread, rho: ViewerRoughness | None, nearest: Sequence[Nearest]
) -> FittedMaterial:
    """The material with its errors, intervals and verdicts.

    Args:
        name: of the material.
        fit: what was found.
        spread: covariance of its free vector.
        rho: the viewer's roughness and its error; None where the fit was made in the viewer's own model, which
            leaves alpha to the first guess ρ/(2√2), or where the material has no roughness.
        nearest: known metals, nearest first.
    """
    kind = fit.material.type
    found = {key: _measured(fit, spread, key) for key in QUANTITIES[kind]}
    if rho is not None:
        found["alpha"], found["roughness"] = found["roughness"], [_of_viewer(rho)]
    elif kind != "matte":
        found |= {key: [_unmeasured(each.value) for each in found[key]] for key in ("n", "k") if key in found}
        found["alpha"] = [_unmeasured(found["roughness"][0].value / RHO_PER_ALPHA)]
    trusted = fit.solution.status == "converged"
    return FittedMaterial(
        name=name,
        type=kind,
        **_each(found, lambda key, each: each.value),
        stderr=StandardErrors(**_each(found, lambda key, each: each.stderr)),
        interval95=Intervals(**_each(found, lambda key, each: each.interval)),
        determined=Determined(**_each(found, lambda key, each: trusted and each.is_determined(_rule(kind, key)))),
        nearest=tuple(nearest),
    )


def _rule(kind: str, key: str) -> str:
    """By which parameter's rule a number counts as determined: 0.02 says much of a metal's F0, and nothing of 0.04."""
    return "reflectance" if (kind, key) == ("glossy", "f0") else key


def status_of(choices: Sequence[Choice], materials: Sequence[FittedMaterial]) -> Status:
    """stopped where a solver did not finish; not_determined where a material's essential numbers are not."""
    if any(choice.fit.solution.status == "stopped" for choice in choices):
        return "stopped"
    return "converged" if all(_is_usable(material) for material in materials) else "not_determined"


def _is_usable(material: FittedMaterial) -> bool:
    in_viewers_model = material.stderr.alpha is None
    verdicts: list[bool | None] = []
    for key in ESSENTIAL[material.type]:
        verdict = getattr(material.determined, "roughness" if key == "alpha" and in_viewers_model else key)
        verdicts += verdict if isinstance(verdict, tuple) else [verdict]
    return all(verdicts)


def describe(choice: Choice, material: FittedMaterial) -> str:
    """A few sentences for a person: how the fit ended, and what the photographs do not tell."""
    fit = choice.fit
    steps = f"in {fit.solution.steps} steps"
    ending = f"converged {steps}" if fit.solution.status == "converged" else f"stopped {steps} without converging"
    sentences = [f"The fit {ending}.", *_on_the_type(choice)]
    unknown = [_undetermined(material, key) for key in ("f0", "n", "k", "color") if _channels(material, key)]
    if material.determined.alpha is False:
        unknown.append(f"alpha ({_range(material.interval95.alpha)})")
    if unknown:
        sentences.append(f"The photographs do not determine {'; '.join(unknown)}.")
    limit = NO_METAL_BEYOND if material.type == "metal" else 1.0
    shining = [channel for channel, f0 in zip(CHANNELS, material.f0 or (), strict=False) if f0 > limit]
    if shining:
        sentences.append(
            f"F0 of {' and '.join(shining)} runs into 1: the object seems to send more light than it receives, so that"
            " exposure or scale of the environment is wrong, or the environment itself."
        )
    return " ".join(sentences)


def _on_the_type(choice: Choice) -> list[str]:
    """Which type was chosen and by how much, where there was a choice."""
    if choice.runner_up is None:
        return []
    kind, behind = choice.runner_up
    lead = f"is the type that explains the photographs best; {kind} comes next, its information criterion (BIC)"
    doubt = "" if behind > DECISIVE else f", less than the {DECISIVE:g} that would decide: give the type with --type"
    return [f"{choice.fit.material.type.capitalize()} {lead} is worse by {behind:.4g}{doubt}."]


@dataclass(frozen=True)
class _Measured:
    """A number with its standard error and 95 % interval, None where it has none."""

    value: float
    stderr: float | None
    interval: tuple[float, float] | None

    def is_determined(self, parameter: str) -> bool:
        return self.interval is not None and is_determined(parameter, self.value, self.interval)


def _measured(fit: Fit, spread: Spread, key: str) -> list[_Measured]:
    coordinates, of_material = fit.residuals.coordinates, QUANTITIES[fit.material.type][key]

    def quantity(x: Tensor) -> Tensor:
        return of_material(coordinates.material(x))

    errors = standard_errors(quantity, fit.x, spread)
    lows, highs = intervals95(quantity, fit.x, spread)
    rows = zip(quantity(fit.x).tolist(), errors.tolist(), lows.tolist(), highs.tolist(), strict=True)
    most = 1.0 if key in ("color", "reflectance") else math.inf  # a matte fit may go beyond
    return [
        _Measured(min(value, most), error, (min(low, most), min(high, most)))
        if all(map(math.isfinite, (error, low, high)))
        else _unmeasured(min(value, most))
        for value, error, low, high in rows
    ]


def _unmeasured(value: float) -> _Measured:
    return _Measured(value, None, None)


def _of_viewer(rho: ViewerRoughness) -> _Measured:
    if not math.isfinite(rho.stderr):
        return _unmeasured(rho.rho)
    half = TWO_SIDED_95 * rho.stderr
    return _Measured(rho.rho, rho.stderr, (max(0.0, rho.rho - half), rho.rho + half))


def _each(found: dict[str, list[_Measured]], part: Callable[[str, _Measured], object]) -> dict:
    """One part of every number by parameter; alpha and roughness have no channels."""
    parts = {key: [part(key, each) for each in measured] for key, measured in found.items()}
    return {key: each if len(each) == 3 else each[0] for key, each in parts.items()}


def _channels(material: FittedMaterial, key: str) -> list[int]:
    return [i for i, known in enumerate(getattr(material.determined, key) or ()) if not known]


def _undetermined(material: FittedMaterial, key: str) -> str:
    intervals = getattr(material.interval95, key)
    return f"{key} of " + ", ".join(f"{CHANNELS[i]} ({_range(intervals[i])})" for i in _channels(material, key))


def _range(interval: tuple[float, float] | None) -> str:
    return "anywhere" if interval is None else f"{interval[0]:.3g} to {interval[1]:.3g}"
