"""The surroundings in a few hundred blocks, of which each pixel draws those most often that its lobe shows bright.

Drawn in proportion to all light, directions go to the brightest lamps, wherever they are; what a pixel shows is the
lamp that its lobe points at, dim as it may be. So a block is chosen by its light times the lobe in its direction, and
a direction inside the block by the light alone [product sampling, after Clarberg 2005].
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.environment.environment import Environment, directions
from fit_material.shaders.optics import microfacets

ROWS, COLUMNS = 16, 32  # blocks of 11°: within them a lobe as wide as 0.1 hardly changes
EVEN = 0.1  # fraction of the directions drawn by the light alone, so that no block is ever left out


@dataclass(frozen=True)
class ImportanceBlocks:
    """Blocks of texels.

    Attributes:
        share: of all light, by block, float64.
        first: light of all blocks before, float64.
        towards: unit directions to the middle of each block's light, world space.
        spread: mean squared angle of its light about that.
        of_row, of_column: a texel's block is the sum of its row's and its column's number.
    """

    share: Float[Tensor, " k"]
    first: Float[Tensor, " k"]
    towards: Float[Tensor, "k 3"]
    spread: Float[Tensor, " k"]
    of_row: Int[Tensor, " h"]
    of_column: Int[Tensor, " w"]

    def at(self, row: Int[Tensor, "*p"], column: Int[Tensor, "*p"]) -> Int[Tensor, "*p"]:
        """Block of a texel."""
        return self.of_row[row] + self.of_column[column]


def build(environment: Environment, share: Float[Tensor, "h w"]) -> ImportanceBlocks:
    """The blocks of an environment whose texels have these shares of all light."""
    height, width = share.shape
    device = share.device
    of_row = torch.arange(height, device=device) * ROWS // height * COLUMNS
    of_column = torch.arange(width, device=device) * COLUMNS // width
    block = (of_row[:, None] + of_column).flatten()

    def summed(values: Tensor) -> Tensor:
        return values.new_zeros(ROWS * COLUMNS, *values.shape[1:]).index_add_(0, block, values)

    total = summed(share.flatten())
    towards = turned(directions(height, width).to(device), environment.rotation).reshape(-1, 3)
    middle = summed(towards * share.flatten()[:, None]) / total.clamp_min(1e-300)[:, None]
    length = middle.norm(dim=1)
    spread = 2 * (1 - length).clamp_min(0)  # the mean of 2 (1 - cos) about the mean direction
    towards = (middle / length.clamp_min(1e-12)[:, None]).float()
    return ImportanceBlocks(total, total.cumsum(0) - total, towards, spread.float(), of_row, of_column)


def turned(towards: Float[Tensor, "*p 3"], degrees: float) -> Float[Tensor, "*p 3"]:
    """Directions of the map's own axes in world space: the map is rotated about +Y, counter-clockwise from above."""
    angle = torch.deg2rad(torch.tensor(degrees, dtype=towards.dtype))
    cos, sin = torch.cos(angle), torch.sin(angle)
    x, y, z = towards.unbind(-1)
    return torch.stack([x * cos + z * sin, y, z * cos - x * sin], -1)


def width(alpha: float, tilt: Float[Tensor, " p"]) -> Float[Tensor, " p"]:
    """Of the lobe that all of a pixel shows, a microfacet width: facets' slopes and the surface's own add up.

    α² is the variance of slopes along both axes together; the surface bends along one more than along the other, and
    counts as if it did so along both.

    Args:
        alpha: microfacet width.
        tilt: mean squared angle between the pixel's normals and their mean.
    """
    return (alpha**2 + 2 * tilt).sqrt()


def chances(
    blocks: ImportanceBlocks,
    cos_v: Float[Tensor, "p 1"],
    sin_v: Float[Tensor, "p 1"],
    towards: tuple[Float[Tensor, "p k"], ...],
    alpha: Float[Tensor, "p 1"],
) -> Float[Tensor, "p k"]:
    """Probability of each block, by pixel.

    The lobe is widened by the block's own extent, for its middle stands for all of it.

    Args:
        cos_v, sin_v: of the view in the frame of the pixel's mean ray.
        towards: the blocks' directions in that frame.
        alpha: see `width`.
    """
    x, y, z = towards
    hx, hz = x + sin_v, z + cos_v
    cos2_h = hz**2 / (hx**2 + y**2 + hz**2).clamp_min(1e-12)
    alpha2 = alpha**2 + blocks.spread / 4  # a half vector turns by half the angle
    facets = alpha2 / (1 - cos2_h * (1 - alpha2)).square().clamp_min(1e-30)
    cos_l = (z + blocks.spread.sqrt()).clamp(0, 1)
    seen = blocks.share.float() * facets * (hz > 0) * microfacets.smith_g1(cos_l, alpha2.sqrt(), "ggx")
    product = seen / seen.sum(1, keepdim=True).clamp_min(1e-30)
    mixed = (1 - EVEN) * product + EVEN * blocks.share.float()
    return mixed / mixed.sum(1, keepdim=True)
