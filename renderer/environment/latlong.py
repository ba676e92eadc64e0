"""Bilinear lookups in a latitude-longitude environment, seamless and laid out as Mitsuba's `envmap`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.environment.environment import Environment
from fit_material.shaders.optics.safe_sqrt import root


@dataclass(frozen=True)
class LatLong:
    """Channels over the sphere of directions.

    Attributes:
        texels: [1, c, h + 2, w + 2]; a border of one texel, wrapped left and right and repeated at the poles, makes
            every lookup an ordinary one.
        rotation: degrees by which the map is rotated about +Y.
    """

    texels: Float[Tensor, "1 c h+2 w+2"]
    rotation: float


def of(environment: Environment, *further: Float[Tensor, "h w"]) -> LatLong:
    """The map of an environment's red, green and blue, and of any further channels."""
    channels = torch.cat([environment.radiance, *(channel[..., None] for channel in further)], 2)
    return LatLong(with_border(channels.permute(2, 0, 1)[None]), environment.rotation)


def lookup(
    latlong: LatLong, x: Float[Tensor, "*p"], y: Float[Tensor, "*p"], z: Float[Tensor, "*p"]
) -> Float[Tensor, "*p c"]:
    """All channels in given directions.

    As in Mitsuba u = atan2(x, -z)/2π has its column centres at (i + ½)/w, and v = acos(y)/π its row centres at
    j/(h - 1), so that the outermost rows lie at the poles.

    Args:
        x, y, z: components of unit directions in world space.

    Returns:
        values in the dtype of the texels.
    """
    rows, columns = latlong.texels.shape[2:]
    x, z = _zero_at_the_poles(x, z)
    u = torch.atan2(x, -z) / (2 * math.pi) + latlong.rotation / 360
    v = polar_angle(x, y, z) / math.pi
    column = (u - u.floor()) * (columns - 2) + 1
    row = v * (rows - 3) + 1.5
    grid = torch.stack([column * (2 / columns) - 1, row * (2 / rows) - 1], -1).reshape(1, -1, 1, 2).to(latlong.texels)
    found = torch.nn.functional.grid_sample(latlong.texels, grid, mode="bilinear", align_corners=False)
    return found[0, :, :, 0].T.reshape(*x.shape, -1)


def _zero_at_the_poles(
    x: Float[Tensor, "*p"], z: Float[Tensor, "*p"]
) -> tuple[Float[Tensor, "*p"], Float[Tensor, "*p"]]:
    """x and z, both 0 where x² + z² is no normal number: the azimuth's slope, z/(x² + z²), would be infinite there."""
    away = x**2 + z**2 >= torch.finfo(x.dtype).tiny
    return torch.where(away, x, 0.0), torch.where(away, z, 0.0)


def polar_angle(x: Float[Tensor, "*p"], y: Float[Tensor, "*p"], z: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
    """Angle from +Y of unit directions, in [0, π].

    Its cosine alone would keep half of the digits at the poles, in float32 a texel of a map of 8192 columns, and an
    infinite slope.
    """
    return torch.atan2(root(x**2 + z**2), y)


def row_edges(height: int) -> Float[Tensor, " h+1"]:
    """Polar angles between which the texels of each row lie, from 0 to π, float64."""
    if height == 1:
        return torch.tensor([0.0, math.pi], dtype=torch.float64)
    between = (torch.arange(height - 1, dtype=torch.float64) + 0.5) * math.pi / (height - 1)
    return torch.cat([torch.zeros(1), between, torch.full((1,), math.pi)])


def row_solid_angle(height: int, width: int) -> Float[Tensor, " h"]:
    """Solid angle of one texel in each row, in steradian, float64; the first and last row are polar caps."""
    return -row_edges(height).cos().diff() * 2 * math.pi / width


def with_border(channels: Float[Tensor, "1 c h w"]) -> Float[Tensor, "1 c h+2 w+2"]:
    """One more texel on each side: the other end of the row, and the polar row once more."""
    wrapped = torch.nn.functional.pad(channels, (1, 1, 0, 0), mode="circular")
    return torch.nn.functional.pad(wrapped, (0, 0, 1, 1), mode="replicate")


def texel_solid_angles(height: int, width: int) -> Float[np.ndarray, "h 1"]:
    """Solid angle that a texel of each row stands for under bilinear lookup, steradians.

    A row weighs sin θ with the tent of half width δ = π/(h-1) round it:

        Ω = 2π/w · sin θ · 2 (1 - cos δ)/δ       θ not at a pole
        Ω = 2π/w · (1 - sin δ/δ)                 at the poles, where half of the tent remains
    """
    step = np.pi / (height - 1)
    rows = np.sin(step * np.arange(height)) * 2 * (1 - np.cos(step)) / step
    rows[[0, -1]] = 1 - np.sin(step) / step
    return 2 * np.pi / width * rows[:, None]
