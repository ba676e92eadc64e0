"""A fit in the words and numbers of `result.json`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
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
from fitter.uncertainty import Spread, interval95, is_determined, standard_errors
from fitter.viewer_roughness import ViewerRoughness

CHANNELS = ("red", "green", "blue")
DOMAIN = {"n": (0.0, math.inf), "k": (0.0, math.inf), "f0": (0.0, 1.0), "alpha": (0.0, math.inf)}
DOMAIN["roughness"] = DOMAIN["alpha"]
RHO_PER_ALPHA = 2 * math.sqrt(2)  # of a narrow Beckmann lobe; a first guess for other lobes [MODEL.md 6]


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
    metal = fit.metal
    values: dict[str, list[float]] = {"n": metal.n.tolist(), "k": metal.k.tolist(), "f0": metal.f0.tolist()}
    errors: dict[str, list[float | None]] = {key: _errors(fit, spread, key) for key in values}
    roughness, error = float(metal.roughness), _errors(fit, spread, "roughness")
    if rho is None:
        values |= {"roughness": [roughness], "alpha": [roughness / RHO_PER_ALPHA]}
        errors |= {"roughness": error, "alpha": [None], "n": [None] * 3, "k": [None] * 3}
    else:
        values |= {"alpha": [roughness], "roughness": [rho.rho]}
        errors |= {"alpha": error, "roughness": [rho.stderr if math.isfinite(rho.stderr) else None]}
    return FittedMaterial(
        name=name,
        type="metal",
        **_shaped(values),
        stderr=StandardErrors(**_shaped(errors)),
        interval95=Intervals(**_shaped(_each(values, errors, _interval))),
        determined=Determined(**_shaped(_each(values, errors, _verdict))),
        nearest=tuple(nearest),
    )


def status_of(fit: Fit, material: FittedMaterial) -> Status:
    """stopped where the solver did not finish; not_determined where F0 or the roughness are not."""
    if fit.solution.status == "stopped":
        return "stopped"
    verdicts = material.determined
    essential = [*(verdicts.f0 or ()), verdicts.alpha if verdicts.alpha is not None else verdicts.roughness]
    return "converged" if all(essential) else "not_determined"


def describe(fit: Fit, material: FittedMaterial, repaired: int) -> str:
    """One sentence or a few, for a person: how the fit ended, and what the photographs do not tell."""
    steps = f"in {fit.solution.steps} steps"
    ending = f"converged {steps}" if fit.solution.status == "converged" else f"stopped {steps} without converging"
    sentences = [f"The fit {ending}."]
    unknown = [_undetermined(material, key) for key in ("f0", "n", "k") if _channels(material, key)]
    if material.determined.alpha is False:
        unknown.append(f"alpha ({_range(material.interval95.alpha)})")
    if unknown:
        sentences.append(f"The photographs do not determine {'; '.join(unknown)}.")
    if repaired:
        sentences.append(f"{repaired} texels of the environment were negative or not finite and were replaced.")
    return " ".join(sentences)


def _errors(fit: Fit, spread: Spread, key: str) -> list[float | None]:
    coordinates = fit.residuals.coordinates
    quantity: dict[str, Callable[[Tensor], Tensor]] = {
        "n": lambda x: coordinates.metal(x).n,
        "k": lambda x: coordinates.metal(x).k,
        "f0": lambda x: coordinates.metal(x).f0,
        "roughness": lambda x: coordinates.metal(x).roughness[None],
    }
    found = standard_errors(quantity[key], fit.x, spread)
    return [float(error) if torch.isfinite(error) else None for error in found]


def _each(
    values: dict[str, list[float]],
    errors: dict[str, list[float | None]],
    judge: Callable[[str, float, float | None], object],
) -> dict[str, list]:
    return {
        key: [judge(key, value, error) for value, error in zip(values[key], errors[key], strict=True)] for key in values
    }


def _interval(key: str, value: float, error: float | None) -> tuple[float, float] | None:
    if error is None:
        return None
    low, high = interval95(value, error, *DOMAIN[key])
    return low, min(high, 1e12)  # JSON has no infinity; no index of refraction comes near


def _verdict(key: str, value: float, error: float | None) -> bool:
    return error is not None and is_determined(key, value, error)


def _shaped(parameters: dict[str, list]) -> dict:
    """Lists of one become the thing itself: alpha and roughness have no channels."""
    return {key: each if len(each) == 3 else each[0] for key, each in parameters.items()}


def _channels(material: FittedMaterial, key: str) -> list[int]:
    return [i for i, known in enumerate(getattr(material.determined, key)) if not known]


def _undetermined(material: FittedMaterial, key: str) -> str:
    intervals = getattr(material.interval95, key)
    return f"{key} of " + ", ".join(f"{CHANNELS[i]} ({_range(intervals[i])})" for i in _channels(material, key))


def _range(interval: tuple[float, float] | None) -> str:
    return "anywhere" if interval is None else f"{interval[0]:.3g} to {interval[1]:.3g}"
