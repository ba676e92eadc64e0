"""Directions drawn where the light is: what finds a small bright lamp that a wide lobe would miss."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.environment.latlong import polar_angle, row_edges, row_solid_angle, with_border
from fit_material.renderer.light_sampling import product_sampling
from fit_material.renderer.light_sampling.product_sampling import ImportanceBlocks


@dataclass(frozen=True)
class EnvironmentSampler:
    """Draws texels of an environment in proportion to their light, along a curve that keeps neighbours together.

    Attributes:
        order: texels (row · width + column) by block, in each along a Z-order curve: strata of the sum are compact.
        cumulative: share of all light up to and including each texel of `order`, float64.
        density: density per steradian of each texel, by row · width + column.
        width, height, rotation: of the environment.
    """

    order: Int[Tensor, " t"]
    cumulative: Float[Tensor, " t"]
    density: Float[Tensor, " t"]
    width: int
    height: int
    rotation: float
    blocks: ImportanceBlocks


def build(environment: Environment) -> EnvironmentSampler:
    """The sampler of an environment."""
    height, width = environment.radiance.shape[:2]
    density = sampling_density(environment)
    share = density.double() * row_solid_angle(height, width).to(density.device)[:, None]
    share = share / share.sum()
    blocks = product_sampling.build(environment, share)
    order = torch.from_numpy(_z_order(height, width)).to(density.device)
    order = order[torch.argsort(blocks.at(order // width, order % width), stable=True)]
    cumulative = share.flatten()[order].cumsum(0)
    cumulative = cumulative / cumulative[-1]
    return EnvironmentSampler(order, cumulative, density.flatten(), width, height, environment.rotation, blocks)


def sample(
    lamps: EnvironmentSampler, u: Float[Tensor, "*p"], u1: Float[Tensor, "*p"], u2: Float[Tensor, "*p"]
) -> tuple[Float[Tensor, "*p"], Float[Tensor, "*p"], Float[Tensor, "*p"], Float[Tensor, "*p"]]:
    """Directions with a density that is constant within each texel.

    Args:
        u: chooses the texel, in [0, 1).
        u1, u2: choose the place within it, uniformly in solid angle, in [0, 1).

    Returns:
        x, y, z of unit directions in world space, and their density per steradian.
    """
    at = torch.searchsorted(lamps.cumulative, u.double(), right=True).clamp_max(len(lamps.order) - 1)
    texel = lamps.order[at]
    row, column = texel // lamps.width, texel % lamps.width
    cosines = row_edges(lamps.height).cos().to(u1)
    y = cosines[row] + u1 * (cosines[row + 1] - cosines[row])
    azimuth = 2 * math.pi * ((column + u2) / lamps.width - lamps.rotation / 360)
    radius = ((1 - y) * (1 + y)).clamp_min(0).sqrt()
    return radius * torch.sin(azimuth), y, -radius * torch.cos(azimuth), lamps.density[texel]


def texels(
    lamps: EnvironmentSampler, x: Float[Tensor, "*p"], y: Float[Tensor, "*p"], z: Float[Tensor, "*p"]
) -> tuple[Int[Tensor, "*p"], Int[Tensor, "*p"]]:
    """Row and column of the texel that each unit direction in world space falls into."""
    u = torch.atan2(x, -z) / (2 * math.pi) + lamps.rotation / 360
    row = polar_angle(x, y, z) / math.pi * (lamps.height - 1) + 0.5
    column = (u - u.floor()) * lamps.width
    return row.long().clamp_max(lamps.height - 1), column.long().clamp_max(lamps.width - 1)


def sampling_density(environment: Environment) -> Float[Tensor, "h w"]:
    """Density per steradian of directions drawn in proportion to the light, one value per texel.

    Each texel counts the mean of itself and its eight neighbours, so that the half of a bilinear ramp that lies in
    the dark texel beside a lamp is drawn as well.
    """
    light = environment.radiance.mean(2)[None, None]
    spread = torch.nn.functional.avg_pool2d(with_border(light), 3, stride=1)[0, 0]
    total = (spread.double() * row_solid_angle(*spread.shape).to(spread.device)[:, None]).sum()
    return (spread / total).to(environment.radiance)


def _z_order(height: int, width: int) -> Int[np.ndarray, " t"]:
    """Indices row · width + column of all texels, sorted along a Z-order curve [Morton 1966]."""
    return along_z_order(*np.divmod(np.arange(height * width), width))


def along_z_order(row: Int[np.ndarray, " t"], column: Int[np.ndarray, " t"]) -> Int[np.ndarray, " t"]:
    """Indices that sort places of a grid, rows and columns from 0, along a Z-order curve."""
    row, column = row.astype(np.uint64), column.astype(np.uint64)
    return np.argsort(_spread_bits(row) << np.uint64(1) | _spread_bits(column), kind="stable").astype(np.int64)


def _spread_bits(value: np.ndarray) -> np.ndarray:
    """Each bit b of a number below 2³² moved to bit 2b."""
    for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F)):
        value = (value | value << np.uint64(shift)) & np.uint64(mask)
    value = (value | value << np.uint64(2)) & np.uint64(0x3333333333333333)
    return (value | value << np.uint64(1)) & np.uint64(0x5555555555555555)
