"""What is done with solvers at corners, at bounds, without rank, without numbers, without steps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.least_squares.covariance import sandwich_covariance
from fit_material.fitter.least_squares.reduced_residuals import condensed
from fit_material.fitter.least_squares.residuals import Residuals
from fit_material.fitter.least_squares.solvers import SOLVERS, Residual, Solution
from fit_material.fitter.selftest.experiments import small_scene
from fit_material.fitter.selftest.experiments.row import Numbers
from fit_material.fitter.selftest.experiments.small_scene import COORDINATES, Told
from fit_material.shaders.materials.fresnel_models import REFLECTANCES


def residuals_in(numbers: Numbers, noise: float = small_scene.NOISE) -> Residuals:
    light = small_scene.table(numbers.dtype, numbers.device)
    return small_scene.residuals_of(light, small_scene.photograph(light, noise))


def cost(residuals: Residual, x: Tensor) -> float:
    return 0.5 * float(residuals(x).square().sum())


def corners(numbers: Numbers) -> str | None:
    """From every corner of F0, tint and roughness, of all channels alike: never worse than it began, never NaN."""
    residuals = residuals_in(numbers)
    for corner in itertools.product((-6.0, 6.0), repeat=3):
        start = torch.tensor([corner[0]] * 3 + [corner[1]] * 3 + [corner[2]], dtype=torch.float64)
        short = condensed(residuals, start)  # as a fit has them; every corner has outliers of its own
        found = SOLVERS["lm"](short, start)
        least = cost(short, COORDINATES.free(small_scene.gold()))
        sentence = sound(found, cost(short, start)) or honest(short, found, least)
        if sentence:
            return f"from {corner}: {sentence}"
    return None


def sound(found: Solution, before: float) -> str | None:
    if not (found.x.isfinite().all() and math.isfinite(found.cost)):
        return f"ends at {found.x.tolist()} with cost {found.cost}"
    return (
        None if found.cost <= before * (1 + 1e-12) else f"ends at cost {found.cost:.6g}, above the start's {before:.6g}"
    )


def honest(residuals: Residual, found: Solution, least: float) -> str | None:
    """What calls itself converged has a slope of next to nothing: a standard error of the cost's."""
    if found.status != "converged":
        return None
    x = found.x.clone().requires_grad_()
    (slope,) = torch.autograd.grad(0.5 * residuals(x).square().sum(), x)
    size = float(slope.abs().max())
    allowed = 1e-2 * max(found.cost, least)
    return None if size < allowed else f"calls itself converged at a slope of {size:.3g}, allowed {allowed:.3g}"


def from_start(start: Callable[[], Tensor]) -> Callable[[Numbers], str | None]:
    def ends(numbers: Numbers) -> str | None:
        residuals = residuals_in(numbers)
        found = small_scene.fitted(residuals, start()).solution
        return sound(found, cost(residuals, start())) or honest(residuals, found, found.cost)

    return ends


def at_the_truth(numbers: Numbers) -> float:
    """How far a fit of a picture without noise walks away from what made it."""
    truth = COORDINATES.free(small_scene.gold())
    residuals = residuals_in(numbers, noise=0.0)
    bare = replace(residuals, coordinates=replace(COORDINATES, tint=truth[3:6]))  # nothing known beforehand
    start = torch.cat([truth[:3], truth[6:]])
    return float((small_scene.fitted(bare, start).x - start).abs().max())


def told(seen: Callable[[Residuals], Residuals] = lambda residuals: residuals, **how: Any) -> Callable[[Numbers], Told]:
    return lambda numbers: small_scene.told(seen(residuals_in(numbers)), **how)


def by_f0_alone(residuals: Residuals) -> Residuals:
    return replace(residuals, model=small_scene.model(residuals.model.table, REFLECTANCES["lazanyi"]))  # type: ignore[arg-type]


def without_rank(numbers: Numbers) -> str | None:
    """Two unknowns that act alike, and one that does nothing, under every solver."""
    target = torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64)

    def residual(x: Float[Tensor, "4"]) -> Float[Tensor, "3"]:
        return torch.stack([x[0] + x[1], x[2], x[0] + x[1] + x[2]]) - target + 0 * x[3]

    (best,) = np.linalg.lstsq(np.array([[1, 0], [0, 1], [1, 1]]), target.numpy(), rcond=None)[1] / 2
    for name, solver in SOLVERS.items():
        found = solver(residual, torch.tensor([5.0, 1.0, 3.0, 7.0], dtype=torch.float64))
        if not found.x.isfinite().all() or found.status != "converged" or found.cost > best * (1 + 1e-6):
            return f"{name} ends {found.status} at {found.x.tolist()} with cost {found.cost:.9g}, expected {best:.9g}"
    return None


def cliff(x: Tensor) -> Tensor:
    """NaN beyond x = 1, where the minimum, 2, lies."""
    return torch.stack([torch.sqrt(1 - x[0]) * 0 + x[0] - 2, x[1] - 1])


def nowhere(x: Tensor) -> Tensor:
    return torch.stack([x[0], x[1]]) * math.nan


def exploding(x: Tensor) -> Tensor:
    return torch.stack([torch.exp(700 * x[0]) - 1, x[1]])


def survives(residual: Callable[[Tensor], Tensor], stopped: bool) -> Callable[[Numbers], str | None]:
    def ends(numbers: Numbers) -> str | None:
        start = torch.tensor([0.5, 0.0], dtype=torch.float64)
        for name, solver in SOLVERS.items():
            found = solver(residual, start)
            if not found.x.isfinite().all() or (stopped and found.status != "stopped"):
                return f"{name} ends {found.status} at {found.x.tolist()}"
        return None

    return ends


def few_steps(numbers: Numbers) -> str | None:
    """One step is too few for all of them, and all report it."""
    residuals = residuals_in(numbers)
    for name, solver in SOLVERS.items():
        found = solver(residuals, small_scene.start(), steps=1)
        sentence = sound(found, math.inf)
        if sentence or found.status != "stopped":
            return f"{name}: {sentence or found.status}"
    return None


def single_precision(numbers: Numbers) -> float:
    """Standard errors by which a table in these numbers moves the fit from that of the same table in float64."""
    double = small_scene.table(torch.float64, numbers.device)
    seen = small_scene.photograph(double)
    exact = small_scene.residuals_of(double, seen)
    rounded = small_scene.residuals_of(replace(double, light=double.light.to(numbers.dtype)), seen)
    fit = small_scene.fitted(exact)
    errors = sandwich_covariance(exact, fit.x).covariance.diagonal().sqrt()
    return float(((small_scene.fitted(rounded).x - fit.x) / errors).abs().max())


def moves(change: Callable[[Residuals], Residuals], back: Callable[[Tensor], Tensor] = lambda x: x) -> Any:
    """Standard errors by which the solution moves under what should change nothing."""

    def moved(numbers: Numbers) -> float:
        residuals = residuals_in(numbers)
        plain, other = small_scene.fitted(residuals), small_scene.fitted(change(residuals))
        errors = sandwich_covariance(residuals, plain.x).covariance.diagonal().sqrt()
        return float(((back(other.x) - plain.x) / errors).abs().max())

    return moved


def permuted(residuals: Residuals) -> Residuals:
    """The pixels in another order."""
    order = torch.randperm(len(residuals.photograph), generator=torch.Generator().manual_seed(4))
    return small_scene.residuals_of(residuals.model.table, residuals.photograph, order)  # type: ignore[arg-type]


def channels(residuals: Residuals) -> Residuals:
    """Red, green and blue as blue, red, green, of light and photograph."""
    table, order = residuals.model.table, torch.tensor([2, 0, 1])
    assert table is not None
    return small_scene.residuals_of(replace(table, light=table.light[..., order]), residuals.photograph[:, order])


def scaled(residuals: Residuals) -> Residuals:
    """Light and photograph 2²⁰ times as bright."""
    table = residuals.model.table
    assert table is not None
    return small_scene.residuals_of(replace(table, light=table.light * 2.0**20), residuals.photograph * 2.0**20)


def tolerance(numbers: Numbers) -> float:
    return 1e-2
