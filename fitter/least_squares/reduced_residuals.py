"""Least squares of thousands of pixels as that of a hundred numbers: integrate once, condense once, solve for nothing.

A metal's picture is linear in its mixing u, such as level weights times Fresnel coefficients; only u depends on the
material in other ways. With R a square root of the Gram matrix of the pixels' own equations A u ≈ y, whitened,

    |A u - y|² = |R (u, 1)|²

exactly, whatever u: the solver's steps cost no more for a million pixels than for ten. Photographs of exposures that
are fitted, too, are mixed differently, and are condensed one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.forward.pixel_model import MixedPixels
from fit_material.fitter.least_squares.jacobian import jacobian
from fit_material.fitter.least_squares.residuals import Residuals
from fit_material.fitter.least_squares.sample_halves import Halves
from fit_material.fitter.least_squares.solvers import PRECISE, Residual, Solution, Solver, jacobian_of
from fit_material.renderer.compute.threads import map_in_threads

CHUNK = 1024  # pixels at a time, which bounds the memory for their equations
NEAR = 1e-3  # tolerance that distinguishes the deepest of several minima, whose costs differ by more
REWEIGHTED = 5  # times at most that outliers are weighed anew
STILL = 1e-3  # standard errors by which that may still move the solution


def solved(residuals: Residuals, starts: Sequence[Float[Tensor, " x"]], solver: Solver) -> Solution:
    """The least squares of the residuals: condensed where the picture allows it, else as they are, by the first start.

    Of the minima that the starts lead to, the deepest counts. Outliers are weighed by where the last solution left
    them, at first by the first start, and anew until that moves nothing; which bounds pull is decided with them.
    """
    solution = _solved(residuals, starts, solver)
    return solution if solution.status == "converged" else _solved_but_for_noise(residuals, solution, solver)


def _solved_but_for_noise(residuals: Residuals, stopped: Solution, solver: Solver) -> Solution:
    """Least squares of the directions that the pictures determine.

    Others, which move nothing but noise, are held where the solver stopped: along them there is always noise to fit.
    """
    x = stopped.x
    seen = Halves.at(x, residuals, residuals.robust_whitening(x)).resolved
    if seen.all() or not seen.any():
        return stopped
    whole = condensed(residuals, x) if residuals.mixes(x) else residuals
    found = solver(_Held(whole, x, seen), x[seen])
    steps, seconds = stopped.steps + found.steps, stopped.seconds + found.seconds
    return replace(found, x=torch.where(seen, _scattered(found.x, seen), x), steps=steps, seconds=seconds)


@dataclass(frozen=True)
class _Held:
    """Residuals of some of the free numbers, the others held."""

    residual: Residual
    x: Float[Tensor, " x"]
    free: Bool[Tensor, " x"]

    def __call__(self, y: Float[Tensor, " y"]) -> Float[Tensor, " r"]:
        return self.residual(torch.where(self.free, _scattered(y, self.free), self.x))

    def jacobian(self, y: Float[Tensor, " y"]) -> Float[Tensor, "r y"]:
        return jacobian_of(self.residual)(torch.where(self.free, _scattered(y, self.free), self.x))[:, self.free]


def _scattered(y: Float[Tensor, " y"], where: Bool[Tensor, " x"]) -> Float[Tensor, " x"]:
    """The numbers in their places among more."""
    return y[(where.cumsum(0) - 1).clamp_min(0)]


def _solved(residuals: Residuals, starts: Sequence[Float[Tensor, " x"]], solver: Solver) -> Solution:
    first, *others = starts
    if not residuals.mixes(first):
        return solver(residuals, first)
    short = condensed(residuals, first)
    tried = [solver(short, each, NEAR if others else PRECISE) for each in starts]
    solution = replace(min(tried, key=lambda each: each.cost), seconds=sum(each.seconds for each in tried))
    for _ in range(REWEIGHTED):
        before = solution
        condensate = condensed(residuals, before.x)
        solution = solver(condensate, before.x)
        solution = replace(solution, steps=before.steps + solution.steps, seconds=before.seconds + solution.seconds)
        if float((condensate(solution.x) - condensate(before.x)).norm()) < STILL:
            break
    return solution


@dataclass(frozen=True)
class ReducedResiduals:
    """A short vector with the sum of squares of residuals, as outliers are weighed at one free vector.

    Attributes:
        roots: R, of the Gram matrix of each block of pixels.
        origin: mixing at that free vector, flat; written as differences to it, the equations keep their digits.
        residuals: what was condensed.
    """

    roots: tuple[Float[Tensor, "u+1 u+1"], ...]
    origin: Float[Tensor, "b u"]
    residuals: Residuals

    def __call__(self, x: Float[Tensor, " x"]) -> Float[Tensor, " r"]:
        """R (u - u₀, 1) and the prior."""
        ways, one = _mixing(self.residuals, x) - self.origin, self.origin.new_ones(1)
        blocks = [root @ torch.cat([way, one]) for root, way in zip(self.roots, ways, strict=True)]
        return torch.cat([*blocks, self.residuals.prior(x)])

    def jacobian(self, x: Float[Tensor, " x"]) -> Float[Tensor, "r x"]:
        """Its derivative."""
        count, size = self.origin.shape
        found = jacobian(lambda x: torch.cat([_mixing(self.residuals, x).flatten(), self.residuals.prior(x)]), x)
        mixing, prior = found[: count * size].unflatten(0, (count, size)), found[count * size :]
        return torch.cat([*(root[:, :-1] @ each for root, each in zip(self.roots, mixing, strict=True)), prior])


def condensed(residuals: Residuals, around: Float[Tensor, " x"]) -> ReducedResiduals:
    """The residuals of a model with a mixing, condensed.

    Args:
        residuals: of many pixels.
        around: the free vector at which outliers are weighed.
    """
    model = residuals.model
    assert isinstance(model, MixedPixels)
    whitening, left = residuals.robust_whitening(around), residuals.difference(around)

    def gram(part: slice) -> Float[Tensor, "u u"]:
        equations = torch.einsum("prc,pqc->prqc", whitening[part], model.mixed(part)).flatten(2)
        known = torch.matmul(whitening[part], left[part, :, None])
        rows = torch.cat([equations, known], 2).flatten(0, 1)
        return rows.T @ rows

    def root(pixels: slice) -> Float[Tensor, "u u"]:
        first, end, _ = pixels.indices(len(left))
        parts = [slice(start, min(start + CHUNK, end)) for start in range(first, end, CHUNK)]
        values, vectors = torch.linalg.eigh(torch.stack(list(map_in_threads(gram, parts))).sum(0))
        return values.clamp_min(0).sqrt()[:, None] * vectors.T

    roots = tuple(root(block.pixels) for block in residuals.blocks)
    return ReducedResiduals(roots, _mixing(residuals, around).detach(), residuals)


def _mixing(residuals: Residuals, x: Float[Tensor, " x"]) -> Float[Tensor, "b u"]:
    return residuals.mixing(x).flatten(1)
