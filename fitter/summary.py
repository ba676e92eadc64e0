"""A fit in the words and numbers of `result.json`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from torch import Tensor

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


def fitted_material(
    name: str, fit: Fit, spread: Spread, rho: ViewerRoughness | None, nearest: Sequence[Nearest]
) -> FittedMaterial:
    """The material with its errors, intervals and verdicts.

    Args:
        name: of the material.
        fit: what was found.
        spread: covariance of its free vector.
        rho: the viewer's roughness and its error; None where the fit was made in the viewer's own model, which
            leaves alpha to the first guess ρ/(2√2).
        nearest: known metals, nearest first.
    """
    found = {key: _measured(fit, spread, key) for key in ("n", "k", "f0", "roughness")}
    if rho is None:
        guess = float(fit.metal.roughness) / RHO_PER_ALPHA
        found |= {key: [_unmeasured(each.value) for each in found[key]] for key in ("n", "k")}
        found["alpha"] = [_unmeasured(guess)]
    else:
        found["alpha"], found["roughness"] = found["roughness"], [_of_viewer(rho)]
    trusted = fit.solution.status == "converged"
    return FittedMaterial(
        name=name,
        type="metal",
        **_each(found, lambda key, each: each.value),
        stderr=StandardErrors(**_each(found, lambda key, each: each.stderr)),
        interval95=Intervals(**_each(found, lambda key, each: each.interval)),
        determined=Determined(**_each(found, lambda key, each: trusted and each.is_determined(key))),
        nearest=tuple(nearest),
    )


def status_of(fit: Fit, material: FittedMaterial) -> Status:
    """stopped where the solver did not finish; not_determined where F0 or the roughness are not."""
    if fit.solution.status == "stopped":
        return "stopped"
    verdicts = material.determined
    in_viewers_model = material.stderr.alpha is None
    essential = [*(verdicts.f0 or ()), verdicts.roughness if in_viewers_model else verdicts.alpha]
    return "converged" if all(essential) else "not_determined"


def describe(fit: Fit, material: FittedMaterial, remarks: Sequence[str]) -> str:
    """A few sentences for a person: how the fit ended, what the photographs do not tell, and what else to know.

    Args:
        fit, material: what was found.
        remarks: sentences about the input.
    """
    steps = f"in {fit.solution.steps} steps"
    ending = f"converged {steps}" if fit.solution.status == "converged" else f"stopped {steps} without converging"
    sentences = [f"The fit {ending}."]
    unknown = [_undetermined(material, key) for key in ("f0", "n", "k") if _channels(material, key)]
    if material.determined.alpha is False:
        unknown.append(f"alpha ({_range(material.interval95.alpha)})")
    if unknown:
        sentences.append(f"The photographs do not determine {'; '.join(unknown)}.")
    shining = [channel for channel, f0 in zip(CHANNELS, material.f0 or (), strict=True) if f0 > NO_METAL_BEYOND]
    if shining:
        sentences.append(
            f"F0 of {' and '.join(shining)} runs into 1: the object seems to send more light than it receives, so that"
            " exposure or scale of the environment is wrong, or the environment itself."
        )
    return " ".join([*sentences, *remarks])


@dataclass(frozen=True)
class _Measured:
    """A number with its standard error and 95 % interval, None where it has none."""

    value: float
    stderr: float | None
    interval: tuple[float, float] | None

    def is_determined(self, parameter: str) -> bool:
        return self.interval is not None and is_determined(parameter, self.value, self.interval)


def _measured(fit: Fit, spread: Spread, key: str) -> list[_Measured]:
    coordinates = fit.residuals.coordinates
    quantity: dict[str, Callable[[Tensor], Tensor]] = {
        "n": lambda x: coordinates.metal(x).n,
        "k": lambda x: coordinates.metal(x).k,
        "f0": lambda x: coordinates.metal(x).f0,
        "roughness": lambda x: coordinates.metal(x).roughness[None],
    }
    errors = standard_errors(quantity[key], fit.x, spread)
    lows, highs = intervals95(quantity[key], fit.x, spread)
    rows = zip(quantity[key](fit.x).tolist(), errors.tolist(), lows.tolist(), highs.tolist(), strict=True)
    return [
        _Measured(value, error, (low, high)) if all(map(math.isfinite, (error, low, high))) else _unmeasured(value)
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
    return [i for i, known in enumerate(getattr(material.determined, key)) if not known]


def _undetermined(material: FittedMaterial, key: str) -> str:
    intervals = getattr(material.interval95, key)
    return f"{key} of " + ", ".join(f"{CHANNELS[i]} ({_range(intervals[i])})" for i in _channels(material, key))


def _range(interval: tuple[float, float] | None) -> str:
    return "anywhere" if interval is None else f"{interval[0]:.3g} to {interval[1]:.3g}"
