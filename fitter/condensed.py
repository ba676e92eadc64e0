"""Least squares of thousands of pixels as that of a hundred numbers: integrate once, condense once, solve for nothing.

A metal's picture is linear in its mixing u, the level weights times the Fresnel coefficients; only u depends on the
material in other ways. With R the triangle of the pixels' own equations A u ≈ y, whitened,

    |A u - y|² = |R (u, 1)|²

exactly, whatever u: the solver's steps cost no more for a million pixels than for ten.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from fitter.pixel_model import ExactPixels
from fitter.residuals import Residuals
from fitter.solve import Solution, Solver
from renderer.threads import map_in_threads

CHUNK = 1024  # pixels at a time, which bounds the memory for their equations
REWEIGHTED = 5  # times at most that outliers are weighed anew
STILL = 1e-3  # standard errors by which that may still move the solution


def solved(residuals: Residuals, start: Float[Tensor, " x"], solver: Solver) -> Solution:
    """The least squares of the residuals: condensed where the picture allows it, else as they are.

    Outliers are weighed by where the last solution left them, and anew until that moves nothing.
    """
    if residuals.model.mixing(residuals.coordinates.material(start)) is None:
        return solver(residuals, start)
    solution = solver(condensed(residuals, start), start)
    for _ in range(REWEIGHTED):
        before = solution
        condensate = condensed(residuals, before.x)
        solution = solver(condensate, before.x)
        solution = replace(solution, steps=before.steps + solution.steps, seconds=before.seconds + solution.seconds)
        if float((condensate(solution.x) - condensate(before.x)).norm()) < STILL:
            break
    return solution


def condensed(residuals: Residuals, around: Float[Tensor, " x"]) -> Callable[[Tensor], Tensor]:
    """A short vector with the sum of squares of the residuals, as outliers are weighed at one free vector.

    Args:
        residuals: of a model with a mixing.
        around: that free vector; written as differences to it, the equations keep their digits.
    """
    model, coordinates = residuals.model, residuals.coordinates
    assert isinstance(model, ExactPixels)
    light = model.light
    assert light is not None
    whitening, left = residuals.robust_whitening(around), residuals.difference(around)

    def mixing(x: Tensor) -> Tensor:
        found = model.mixing(coordinates.material(x))
        assert found is not None
        return found.flatten()

    def gram(first: int) -> Float[Tensor, "u u"]:
        part = slice(first, first + CHUNK)
        equations = torch.einsum("prc,apbc->prabc", whitening[part], light[:, part]).flatten(2)
        known = torch.matmul(whitening[part], left[part, :, None])
        rows = torch.cat([equations, known], 2).flatten(0, 1)
        return rows.T @ rows

    total = sum(map_in_threads(gram, range(0, len(left), CHUNK)))
    values, vectors = torch.linalg.eigh(total)
    triangle = values.clamp_min(0).sqrt()[:, None] * vectors.T
    origin = mixing(around).detach()
    one = torch.ones(1, dtype=torch.float64)

    def residual(x: Tensor) -> Tensor:
        return torch.cat([triangle @ torch.cat([mixing(x) - origin, one]), residuals.prior(x)])

    return residual
