"""A texture by least squares: the colours of all texels at once that explain the photographs' pixels best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from fitter.color_map_rows import Rows
from fitter.noise import MAD_TO_SIGMA, relative_weight
from renderer.textures import texel_weights

ROUNDS = 3  # of weights by what the last one left
ROBUST_AT = 6.0  # standard deviations of the noise, whose skew a nearer threshold would take for darkness
FIRST_SCATTER, FIRST_STEP = 0.02, 0.1  # of pixels and between neighbouring texels, relative, before anything is known
LEAST_SCATTER = 1e-4  # of float32's rounding and of the light's
LEAST_STEP = 1e-3  # between texels of an even surface
ITERATIONS = 200
WITHIN = 1e-5
SEES = 0.5  # of a texel's area, from which a photograph counts as seeing it
COARSEST = 4.0  # texels that a pixel may cover to see any
TOUCHED = 0.05  # of a texel's area in all photographs, from which its colour is solved for


@dataclass(frozen=True)
class Solution:
    """Texels as the photographs have them.

    Attributes:
        color: linear Rec. 709, [h, w, 3]; 0 where not solved.
        solved: whether any pixel says something of the texel.
        photographs: how many see it.
        scatter: of the photographs about the texture, relative.
    """

    color: Float[np.ndarray, "h w 3"]
    solved: Bool[np.ndarray, "h w"]
    photographs: Int[np.ndarray, "h w"]
    scatter: float


def texture_size(rows: Sequence[Rows], smallest: int, largest: int) -> int:
    """Texels along a side so that one is about as large as a pixel of a photograph: a power of two.

    The median is over what the pixels cover of the texture, so that it is not the sides seen from farther away, or
    flatter, that decide.
    """
    area = torch.cat([each.area for each in rows])
    area = area[area > 0]
    if not len(area):
        return smallest
    side = float(area.median()) ** -0.5
    return int(min(max(2 ** round(np.log2(side)), smallest), largest))


def solve(rows: Sequence[Rows], size: int, mean: Float[np.ndarray, "3"]) -> Solution:
    """The texture of size² texels that comes nearest to the photographs.

        Σ w² (seen - surface - body · mean of texels)² / σ² + Σ (c_t - c_u)² / τ²      per channel

    w is one over what the body would send out in its mean colour: a weight that knew a pixel's own noise would favour
    one side of it, and dark texels are to be known as well as bright ones. Neighbouring texels t, u are taken to differ
    by τ, as the last round's do in the root mean square: so texels that pixels hardly touch follow their neighbours,
    and others what is seen. Pixels beyond `ROBUST_AT` σ count by their distance alone.

    Args:
        rows: of each photograph.
        size: of the texture, along either side.
        mean: about what its mean is.
    """
    weights = [_weights(each, size) for each in rows]
    covered = [_coverage(each, weight, size) for each, weight in zip(rows, weights, strict=True)]
    photographs = np.sum([each >= SEES for each in covered], axis=0)
    solved = np.sum(covered, axis=0) >= TOUCHED
    mixing = sparse.vstack(weights, format="csr")
    columns = np.flatnonzero(solved)
    mixing = mixing[:, columns]
    known = np.asarray(mixing.sum(1)).ravel() > 1 - 1e-6  # all of its texels are solved
    seen, surface, body = (
        torch.cat([getattr(each, key) for each in rows]).numpy()[known] for key in ("seen", "surface", "body")
    )
    color, scatter = _rounds(mixing[known], body, seen - surface, surface, mean, _steps(solved, size))
    texture = np.zeros((size * size, 3))
    texture[columns] = color
    shape = (size, size)
    return Solution(texture.reshape(*shape, 3), solved.reshape(shape), photographs.reshape(shape), scatter)


def _weights(rows: Rows, size: int) -> sparse.csr_matrix:
    """How each pixel mixes the texels, [pixels, size²]; each row's sum is 1."""
    index, weight = texel_weights(size, size, rows.uv.double())
    count, each = len(index), int(np.prod(index.shape[1:]))
    start = np.arange(count + 1) * each
    values = (weight / max(1, rows.uv.shape[1])).numpy().ravel()
    found = sparse.csr_matrix((values, index.numpy().ravel().astype(np.int32), start), shape=(count, size * size))
    found.sum_duplicates()
    return found


def _coverage(rows: Rows, weights: sparse.csr_matrix, size: int) -> Float[np.ndarray, " t"]:
    """Share of each texel's area that a photograph's pixels cover, those that are not much larger."""
    texels = rows.area.numpy() * size**2
    return weights.T @ np.where(texels <= COARSEST, texels, 0.0)


def _steps(solved: Bool[np.ndarray, " t"], size: int) -> sparse.csr_matrix:
    """Differences between neighbouring texels, both of them solved for."""
    number = np.full(size * size, -1)
    number[solved] = np.arange(solved.sum())
    number = number.reshape(size, size)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    first, second = (np.concatenate([pair[i].ravel() for pair in pairs]) for i in (0, 1))
    both = (first >= 0) & (second >= 0)
    first, second = first[both], second[both]
    line = np.arange(len(first))
    values = np.concatenate([np.ones(len(first)), -np.ones(len(first))])
    places = (np.concatenate([line, line]), np.concatenate([first, second]))
    return sparse.csr_matrix((values, places), shape=(len(first), int(solved.sum())))


def _rounds(
    mixing: sparse.csr_matrix,
    body: Float[np.ndarray, "p 3"],
    scattered: Float[np.ndarray, "p 3"],
    mirrored: Float[np.ndarray, "p 3"],
    mean: Float[np.ndarray, "3"],
    steps: sparse.csr_matrix,
) -> tuple[Float[np.ndarray, "t 3"], float]:
    """The texels, and the relative scatter about them, from light that bodies scatter and light that is mirrored."""
    color = np.full((mixing.shape[1], 3), 0.5)
    trust, scatter, step = np.ones((len(body), 1)), FIRST_SCATTER, FIRST_STEP
    weight = _weight(mirrored + body * mean)
    for _ in range(ROUNDS):
        certainty = weight * trust / scatter
        for channel in range(3):
            factor, target = (certainty * body)[:, channel], (certainty * scattered)[:, channel]
            color[:, channel] = _least_squares(mixing, factor, target, steps, step, color[:, channel])
        picture = body * (mixing @ color)
        left = weight * (scattered - picture)
        scatter = max(MAD_TO_SIGMA * float(np.median(np.abs(left))), LEAST_SCATTER)
        step = max(float(np.sqrt(np.mean((steps @ color) ** 2))), LEAST_STEP) if steps.shape[0] else FIRST_STEP
        length = np.linalg.norm(left, axis=1, keepdims=True) / scatter / np.sqrt(3)
        trust = np.sqrt(ROBUST_AT / np.maximum(length, ROBUST_AT))
    return color, scatter


def _weight(radiance: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 3"]:
    return relative_weight(torch.from_numpy(radiance)).numpy()


def _least_squares(
    mixing: sparse.csr_matrix,
    factor: Float[np.ndarray, " p"],
    target: Float[np.ndarray, " p"],
    steps: sparse.csr_matrix,
    step: float,
    start: Float[np.ndarray, " t"],
) -> Float[np.ndarray, " t"]:
    """By conjugate gradients, preconditioned by the diagonal."""
    squared, back, smooth = factor**2, mixing.T.tocsr(), (steps.T @ steps / step**2).tocsr()
    diagonal = back.multiply(back) @ squared + smooth.diagonal()
    diagonal = np.where(diagonal > 0, diagonal, 1.0)
    count = mixing.shape[1]
    operator = LinearOperator((count, count), lambda c: back @ (squared * (mixing @ c)) + smooth @ c)  # type: ignore
    preconditioner = LinearOperator((count, count), lambda c: c / diagonal)  # type: ignore[call-arg]
    found, _ = cg(operator, back @ (factor * target), start, rtol=WITHIN, maxiter=ITERATIONS, M=preconditioner)
    return found
