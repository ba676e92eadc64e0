"""A latitude-longitude environment at every resolution, so that one lookup can cover any solid angle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from renderer.environment import Environment


@dataclass(frozen=True)
class Pyramid:
    """The levels of an environment map, packed below each other into one picture.

    Level 0 is the map itself; each further level halves both sides. Every level carries a border of one texel
    (wrapped left and right, repeated at the poles), so that one bilinear lookup in the packed picture is seamless.

    Attributes:
        atlas: [1, 3, rows, columns], the packed levels with their borders.
        first_row: row of each level's upper border in the atlas.
        width, height: size of level 0.
        rotation: degrees by which the map is turned about +Y.
    """

    atlas: Float[Tensor, "1 3 rows columns"]
    first_row: Float[Tensor, " levels"]
    width: int
    height: int
    rotation: float

    @property
    def levels(self) -> int:
        return len(self.first_row)

    @property
    def texel_solid_angle(self) -> float:
        """Solid angle of a level-0 texel at the equator, in steradian."""
        return (2 * math.pi / self.width) * (math.pi / max(self.height - 1, 1))


def build(environment: Environment) -> Pyramid:
    """All levels of `environment`, down to the last whose sides are still whole numbers."""
    level = environment.radiance.permute(2, 0, 1)[None]
    height, width = level.shape[2:]
    solid_angle = _row_solid_angle(height).to(level)[None, None, :, None]
    levels = [level]
    while level.shape[2] % 2 == 0 and level.shape[3] % 2 == 0:
        # Weighted by solid angle, so that a coarse texel holds the mean radiance of the directions it stands for.
        coarser = torch.nn.functional.avg_pool2d(solid_angle, (2, 1))
        level = torch.nn.functional.avg_pool2d(level * solid_angle, 2) / coarser
        solid_angle = coarser
        levels.append(level)
    bordered = [_with_border(level) for level in levels]
    rows = torch.tensor([0, *(level.shape[2] for level in bordered[:-1])]).cumsum(0)
    atlas = torch.cat([torch.nn.functional.pad(b, (0, width + 2 - b.shape[3])) for b in bordered], 2)
    return Pyramid(atlas, rows.to(atlas), width, height, environment.rotation)


def lookup(
    pyramid: Pyramid, x: Float[Tensor, "*p"], y: Float[Tensor, "*p"], z: Float[Tensor, "*p"], level: Tensor
) -> Float[Tensor, "*p 3"]:
    """Radiance from a direction, bilinear within one level.

    Level 0 reproduces Mitsuba's `envmap`: u = atan2(x, -z)/2π with column centres at (i + ½)/w, v = acos(y)/π with
    row centres at j/(h - 1).

    Args:
        x, y, z: components of unit directions in world space.
        level: which level to read, whole numbers >= 0 in a float tensor; clamped to the coarsest.

    Returns:
        radiance [*p, 3].
    """
    scale = torch.exp2(-level.clamp(0, pyramid.levels - 1))
    u = torch.atan2(x, -z) / (2 * math.pi) - pyramid.rotation / 360
    v = torch.acos(y.clamp(-1, 1)) / math.pi
    column = (u - u.floor()) * pyramid.width * scale + 1
    row = (v * (pyramid.height - 1) + 0.5) * scale + 1
    row = row + pyramid.first_row[level.clamp(0, pyramid.levels - 1).long()]
    rows, columns = pyramid.atlas.shape[2:]
    grid = torch.stack([column * (2 / columns) - 1, row * (2 / rows) - 1], -1)
    flat = grid.reshape(1, -1, 1, 2)
    radiance = torch.nn.functional.grid_sample(pyramid.atlas, flat, mode="bilinear", align_corners=False)
    return radiance[0, :, :, 0].T.reshape(*x.shape, 3)


def _row_solid_angle(height: int) -> Float[Tensor, " h"]:
    """Relative solid angle of each row: sin θ within, the polar cap's share in the first and last row."""
    if height == 1:
        return torch.ones(1)
    edge = torch.linspace(0, math.pi, height)
    half = math.pi / (height - 1) / 2
    lower, upper = (edge - half).clamp_min(0), (edge + half).clamp_max(math.pi)
    return torch.cos(lower) - torch.cos(upper)


def _with_border(level: Float[Tensor, "1 3 h w"]) -> Float[Tensor, "1 3 h+2 w+2"]:
    wrapped = torch.nn.functional.pad(level, (1, 1, 0, 0), mode="circular")
    return torch.nn.functional.pad(wrapped, (0, 0, 1, 1), mode="replicate")
