"""A latitude-longitude map at a lower resolution that sends the same light from every part of the sphere."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.environment.latlong import row_edges


def box_filtered(radiance: Float[Tensor, "h w 3"], width: int) -> Float[Tensor, "m n 3"]:
    """The mean radiance over each texel of a map of half as many rows as columns, by solid angle.

    Texels lie as `environment.directions` has them, the outermost rows as polar caps. Σ radiance · solid angle stays
    as it was, of the whole map and of every texel.

    Args:
        radiance: the map.
        width: columns wanted, even; 0, or as many as there are, leaves the map as it is.

    Returns:
        the smaller map, of the same dtype; it never has more columns than the given one.
    """
    height, columns = radiance.shape[:2]
    if not 0 < width < columns:
        return radiance
    rows = _shares(-row_edges(height).cos(), -row_edges(width // 2).cos())
    azimuths = (torch.linspace(0, 1, count + 1, dtype=torch.float64) for count in (columns, width))
    return torch.einsum("mh,hwc,nw->mnc", rows, radiance.double(), _shares(*azimuths)).to(radiance)


def _shares(edges: Float[Tensor, " a"], coarse: Float[Tensor, " b"]) -> Float[Tensor, "n m"]:
    """How much of each coarse interval lies in each fine one; both sets of edges ascend over the same range."""
    low = torch.maximum(coarse[:-1, None], edges[:-1])
    high = torch.minimum(coarse[1:, None], edges[1:])
    return (high - low).clamp_min(0) / coarse.diff()[:, None]
