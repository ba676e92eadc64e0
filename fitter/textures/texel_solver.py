"""A texture by least squares: the colours of all texels at once that explain the photographs' pixels best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.ndimage import gaussian_filter
from scipy.sparse.linalg import LinearOperator, cg

from fit_material.fitter.forward.received_light import DiffuseLight
from fit_material.fitter.forward.surface_samples import Sparse
from fit_material.fitter.least_squares.noise import MAD_TO_SIGMA, relative_weight
from fit_material.fitter.textures.texel_equations import TexelEquations
from fit_material.renderer.images.textures import texel_weights

ROUNDS = 6  # of weights by the last one's residuals
ROBUST_AT = 6.0  # standard deviations of the noise, whose skew a nearer threshold would take for darkness
FIRST_SCATTER, FIRST_STEP = (
    0.02,
    0.1,
)  # of pixels and between texels; a first smoothing that is stronger hides the edges
LEAST_SCATTER = 1e-4  # of float32's rounding and of the light's
OUTLIER = 5.0  # standard deviations beyond which a pixel does not count for the scatter about it
AROUND = 2.0  # texels, standard deviation of the window over which scatter is averaged
STEP = 0.03  # mean size of the steps between neighbouring texels: flat with edges, as most things are
LEAST_STEP = 0.003  # linear, below which steps are not seen
ITERATIONS = 200
WITHIN = 1e-5
SEES = 0.75  # of a texel's area, from which a photograph counts as seeing it
COARSEST = 4.0  # texels that a pixel may cover to see any
TOUCHED = 0.05  # of a texel's area in all photographs, from which its colour is solved for


@dataclass(frozen=True)
class Solution:
    """Texels as the photographs have them.

    Attributes:
        color: linear Rec. 709, [h, w, 3]; 0 where not solved.
        solved: whether any pixel constrains the texel.
        photographs: how many see it.
        scatter: of the photographs about the texture, relative.
    """

    color: Float[np.ndarray, "h w 3"]
    solved: Bool[np.ndarray, "h w"]
    photographs: Int[np.ndarray, "h w"]
    scatter: float


def texture_size(rows: Sequence[TexelEquations], smallest: int, largest: int) -> int:
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


def solve(
    rows: Sequence[TexelEquations], size: int, mean: Float[np.ndarray, "3"], light: DiffuseLight | None = None
) -> Solution:
    """The texture of size² texels that comes nearest to the photographs.

        Σ w² (seen - surface - body · mean of texels)² / 2σ² + Σ |c_t - c_u| / τ

    w is one over what the body would send out in its mean colour: a weight that knew a pixel's own noise would favour
    one side of it, and dark texels are to be known as well as bright ones. σ is the scatter of the pixels around, about
    the last round's texture; beyond `ROBUST_AT` of it they count by their distance alone. Neighbouring texels t, u
    differ by τ = `STEP` in the mean, with the wide tails of total variation [Rudin et al. 1992], by reweighted least
    squares: noise is smoothed where there is nothing else, edges stay, and without noise the prior has no weight.

    Args:
        rows: of each photograph.
        size: of the texture, along either side.
        mean: about what its mean is.
        light: on the object, as `TexelEquations.body` takes it.
    """
    weights = [_weights(each, size) for each in rows]
    covered = [_coverage(each, weight, size) for each, weight in zip(rows, weights, strict=True)]
    photographs = np.sum([each >= SEES for each in covered], axis=0)
    solved = np.sum(covered, axis=0) >= TOUCHED
    mixing: Sparse = sparse.csr_matrix(sparse.vstack(weights))
    columns = np.flatnonzero(solved)
    mixing = mixing[:, columns]
    known = np.asarray(mixing.sum(1)).ravel() > 1 - 1e-6  # all of its texels are solved
    seen = torch.cat([each.seen for each in rows]).numpy()[known]
    surface = np.concatenate([each.mirrored(light) for each in rows])[known]
    body = np.concatenate([each.body(light) for each in rows])[known]
    texture, shape = np.zeros((size * size, 3)), (size, size)
    if not known.any():
        return Solution(texture.reshape(*shape, 3), np.zeros(shape, bool), photographs.reshape(shape), 0.0)
    color, scatter = _rounds(mixing[known], body, seen - surface, surface, mean, _steps(solved, size), (columns, size))
    texture[columns] = color
    return Solution(texture.reshape(*shape, 3), solved.reshape(shape), photographs.reshape(shape), scatter)


def _weights(rows: TexelEquations, size: int) -> Sparse:
    """How each pixel mixes the texels, [pixels, size²]; each row's sum is 1."""
    index, weight = texel_weights(size, size, rows.uv.double())
    count, each = len(index), int(np.prod(index.shape[1:]))
    start = np.arange(count + 1) * each
    values = (weight / max(1, rows.uv.shape[1])).numpy().ravel()
    found = sparse.csr_matrix((values, index.numpy().ravel().astype(np.int32), start), shape=(count, size * size))
    found.sum_duplicates()
    return found


def _coverage(rows: TexelEquations, weights: Sparse, size: int) -> Float[np.ndarray, " t"]:
    """Share of each texel's area that a photograph's pixels cover, those that are not much larger."""
    texels = rows.area.numpy() * size**2
    return weights.T @ np.where(texels <= COARSEST, texels, 0.0)


def _steps(solved: Bool[np.ndarray, " t"], size: int) -> Sparse:
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
    mixing: Sparse,
    body: Float[np.ndarray, "p 3"],
    scattered: Float[np.ndarray, "p 3"],
    mirrored: Float[np.ndarray, "p 3"],
    mean: Float[np.ndarray, "3"],
    steps: Sparse,
    place: tuple[Int[np.ndarray, " t"], int],
) -> tuple[Float[np.ndarray, "t 3"], float]:
    """The texels, and the relative scatter about them, from light that bodies scatter and light that is mirrored."""
    color = np.tile(mean, (mixing.shape[1], 1))
    weight = _weight(mirrored + body * mean)
    equations = _Equations(mixing, mixing.T.tocsr(), steps)
    scatter: Float[np.ndarray, "p 1"] = np.full((len(body), 1), FIRST_SCATTER)
    trust, stiffness = np.ones_like(scatter), np.full(steps.shape[0], 1 / FIRST_STEP**2)
    for _ in range(ROUNDS):
        certainty = weight * trust / scatter
        for channel in range(3):
            factor, target = (certainty * body)[:, channel], (certainty * scattered)[:, channel]
            color[:, channel] = equations.solved(factor, target, stiffness, color[:, channel])
        left = weight * (scattered - body * (mixing @ color))
        scatter = _local_scatter(left, equations, place)
        length = np.linalg.norm(left, axis=1, keepdims=True) / scatter / np.sqrt(3)
        trust = np.sqrt(ROBUST_AT / np.maximum(length, ROBUST_AT))
        change = np.sqrt(np.mean((steps @ color) ** 2, axis=1)) if steps.shape[0] else stiffness
        stiffness = 1 / (STEP * np.maximum(change, LEAST_STEP))
    return color, float(np.median(scatter))


def _local_scatter(
    left: Float[np.ndarray, "p 3"], equations: _Equations, place: tuple[Int[np.ndarray, " t"], int]
) -> Float[np.ndarray, "p 1"]:
    """Scatter about each pixel, from the pixels of all photographs that see the texels around its own."""
    texel, size = place
    squares = np.minimum(left**2, (OUTLIER * MAD_TO_SIGMA * np.median(np.abs(left))) ** 2).mean(1)

    def around(values: Float[np.ndarray, " p"]) -> Float[np.ndarray, " t"]:
        grid = np.zeros(size * size)
        grid[texel] = equations.back @ values
        return gaussian_filter(grid.reshape(size, size), AROUND, mode="constant").ravel()[texel]

    mean = around(squares) / np.maximum(around(np.ones(len(left))), 1e-12)
    return np.sqrt(np.maximum(equations.mixing @ mean, LEAST_SCATTER**2))[:, None]


def _weight(radiance: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 3"]:
    return relative_weight(torch.from_numpy(radiance)).numpy()


@dataclass(frozen=True)
class _Equations:
    """What all channels' and rounds' equations share.

    Attributes:
        mixing: of texels by pixels, [p, t].
        back: its transpose.
        steps: differences between neighbouring texels, [s, t].
    """

    mixing: Sparse
    back: Sparse
    steps: Sparse

    def solved(
        self,
        factor: Float[np.ndarray, " p"],
        target: Float[np.ndarray, " p"],
        stiffness: Float[np.ndarray, " s"],
        start: Float[np.ndarray, " t"],
    ) -> Float[np.ndarray, " t"]:
        """The c that minimise |factor · mixing c - target|² + Σ stiffness (c_t - c_u)².

        By conjugate gradients, preconditioned by the diagonal, from `start`.
        """
        squared, count = factor**2, len(start)
        smooth = (self.steps.T @ self.steps.multiply(stiffness[:, None])).tocsr()
        diagonal = self.back.multiply(self.back) @ squared + smooth.diagonal()
        diagonal = np.where(diagonal > 0, diagonal, 1.0)

        def product(c: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
            return self.back @ (squared * (self.mixing @ c)) + smooth @ c

        operator = LinearOperator((count, count), product)  # type: ignore[call-arg]
        preconditioner = LinearOperator((count, count), lambda c: c / diagonal)  # type: ignore[call-arg]
        found, _ = cg(operator, self.back @ (factor * target), start, rtol=WITHIN, maxiter=ITERATIONS, M=preconditioner)
        return found
