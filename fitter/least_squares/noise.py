"""The noise of the photographs at each pixel, by how it will be weighed.

A whitening W of a pixel turns the difference of three channels, of covariance C, into three numbers of variance 1:
WᵀW = C⁻¹. Channels of one pixel share most of their noise (a path tracer's are made of the same paths, a lamp's
flicker is white), so that their ratios are known far better than themselves; only the whole covariance expresses that.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.renderer.rays.gbuffer import GBuffer

MAD_TO_SIGMA = 1.4826  # of a normal distribution: 1/Φ⁻¹(¾)
DARKEST = 0.05  # of the median radiance, below which noise is no longer taken to be relative
NEIGHBOURS = (
    32  # their 3 × 3 covariance costs a tenth of the variance to be estimated, and they still lie within one lamp
)
APART = 3.0  # of view directions against normals, as distances: pixels of one photograph are neighbours first
ROUNDING = 1e-13  # of a covariance from so many neighbours in float64, over its trace
OUTLIER = 10.0  # median distances beyond which a neighbour counts no more for being still further off


def relative_weight(radiance: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
    """One over the radiance, but no more than 1/`DARKEST` over its median: dark pixels hold offsets, not material."""
    return 1 / _level(radiance)


def scatter(r: Float[Tensor, "*p"]) -> float:
    """Robust standard deviation, 1.4826 times the median absolute value."""
    return MAD_TO_SIGMA * float(r.abs().median())


def even_whitening(weight: Float[Tensor, "p 3"], scatter: float) -> Float[Tensor, "p 3 3"]:
    """W of noise that is independent between channels and `scatter` wherever it is weighed so."""
    return torch.diag_embed(weight / scatter)


def local_whitening(
    difference: Float[Tensor, "p 3"],
    picture: Float[Tensor, "p 3"],
    neighbours: Int[Tensor, "p q"],
    least: float,
    bounded: Bool[Tensor, " p"] | None = None,
) -> Float[Tensor, "p 3 3"]:
    """W of each pixel, from the relative differences that its neighbours show, whitened by Cholesky's factor.

    The pixel itself is excluded: a weight that knew its own noise would favour one side of it. So is its brightness
    taken from its neighbours.

    Args:
        difference: between model and photographs.
        picture: the model's, for the brightness of each pixel.
        neighbours: their indices; see `neighbours_of`.
        least: relative standard deviation below which no noise is believed.
        bounded: pixels of whose channels bounds are known, one by one; they are no pixel's neighbours.
    """
    level = _level(picture)
    of_neighbours = _without_outliers((difference / level)[neighbours])
    covariance = torch.einsum("pqi,pqj->pij", of_neighbours, of_neighbours) / of_neighbours.shape[1]
    # Differences that are alike in all channels and large leave no rank but that of rounding, which may be negative.
    floor = least**2 + ROUNDING * covariance.diagonal(dim1=1, dim2=2).sum(1)
    covariance = covariance + floor[:, None, None] * torch.eye(3, dtype=covariance.dtype)
    lower = torch.linalg.cholesky(covariance)
    brightness = level[neighbours].mean(1)
    whitening = torch.linalg.solve_triangular(lower, torch.diag_embed(1 / brightness), upper=False)
    if bounded is None:
        return whitening
    bound = torch.maximum(picture - difference, brightness)  # clipped pixels are brighter than their neighbours
    alone = torch.diag_embed(1 / (bound * covariance.diagonal(dim1=1, dim2=2).sqrt()))
    return torch.where(bounded[:, None, None], alone, whitening)


def neighbours_of(
    surface: GBuffer, count: int = NEIGHBOURS, left_out: Bool[Tensor, " p"] | None = None
) -> Int[Tensor, "p q"]:
    """The pixels that see the surface and its surroundings most alike, by normal and view; the nearest, which is the
    pixel itself unless it is left out, does not count.

    Args:
        surface: [p] rays.
        count: neighbours wanted; there are fewer where there are fewer pixels, and a lone pixel is its own.
        left_out: pixels that are no pixel's neighbours.
    """
    from scipy.spatial import KDTree

    place = torch.cat([surface.normal, APART * surface.view], -1).numpy()
    among = torch.arange(len(place)) if left_out is None else (~left_out).nonzero()[:, 0]
    count = min(count, len(among) - 1)
    if count < 1:
        return among[:1].expand(len(place), 1)
    _, nearest = KDTree(place[among.numpy()]).query(place, count + 1, workers=-1)
    return among[torch.from_numpy(np.asarray(nearest)[:, 1:])]


def _level(radiance: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
    return torch.maximum(radiance, darkest(radiance))


def darkest(radiance: Float[Tensor, "p 3"]) -> Float[Tensor, "3"]:
    """`DARKEST` of the median, > 0: below it noise is not relative. The other channels constrain a black one."""
    size = radiance.abs()  # noise about 0 has a median of any sign
    lit = size[size > 0]
    anywhere = lit.median() if len(lit) else size.new_ones(())
    return torch.maximum(DARKEST * size.median(0).values, DARKEST**2 * anywhere)


def _without_outliers(difference: Float[Tensor, "p q 3"]) -> Float[Tensor, "p q 3"]:
    """Differences beyond `OUTLIER` times the neighbourhood's median length, cut to that."""
    length = difference.norm(dim=-1)
    most = OUTLIER * length.median(1, keepdim=True).values
    return difference * (most / torch.maximum(length, most).clamp_min(1e-300))[..., None]
