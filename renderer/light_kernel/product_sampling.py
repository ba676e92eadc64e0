"""Choice of blocks of the light by each pixel, inside Dr.Jit kernels; the module of this name is its twin in torch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import torch
from drjit.llvm import Array4f, Float, UInt32
from jaxtyping import Float as Floats
from torch import Tensor

from fit_material.renderer.light_sampling.product_sampling import COLUMNS, EVEN, ROWS, ImportanceBlocks

_COUNT = ROWS * COLUMNS
_WHOLE = 2**32  # a chance of 1, in fixed point
_ROUNDED = 1 - 2e-5  # less what the rounding of as many chances may add up to; the last block takes the rest
_HALVINGS = _COUNT.bit_length() - 1


@dataclass(frozen=True)
class FusedBlocks:
    """The arrays of `ImportanceBlocks`.

    Attributes:
        middles: x, y, z of each block's direction, and its spread.
        shares: of all light, by block.
        first: light of all blocks before, of 2³².
        of_row, of_column: a texel's block is their sum.
    """

    middles: Float
    shares: Float
    first: UInt32
    of_row: UInt32
    of_column: UInt32

    @staticmethod
    def of(blocks: ImportanceBlocks) -> FusedBlocks:
        middles = torch.cat([blocks.towards, blocks.spread[:, None]], 1)
        first = (blocks.first * _WHOLE).round().clamp(0, _WHOLE - 1)
        arrays = (UInt32(table.numpy().astype("uint32")) for table in (first, blocks.of_row, blocks.of_column))
        return FusedBlocks(Float(middles.flatten().numpy()), Float(blocks.share.float().numpy()), *arrays)

    def at(self, row: Any, column: Any) -> Any:
        """Block of a texel."""
        return dr.gather(UInt32, self.of_row, row) + dr.gather(UInt32, self.of_column, column)


@dataclass(frozen=True)
class Asked:
    """Probability of each block, by pixel.

    Attributes:
        blocks: of the light.
        ends: of each pixel, the chance of each block and of all before it, of 2³².
    """

    blocks: FusedBlocks
    ends: UInt32

    @staticmethod
    def by(blocks: FusedBlocks, mean: Floats[Tensor, "p 8"], widths: Floats[Tensor, " p"], even: float = EVEN) -> Asked:
        """The chances for pixels whose mean rays' frames are packed, for lobes of `lamp_blocks.width`."""
        pixel = dr.arange(UInt32, len(mean))
        packed = Float(mean.flatten().numpy())
        axes = [dr.gather(Array4f, packed, 2 * pixel + half) for half in (0, 1)]
        width, evenly = Float(widths.float().numpy()), dr.opaque(Float, even)

        def seen(block: Any) -> Any:
            return _seen(blocks, axes, width, block)

        start = dr.zeros(UInt32, len(mean))
        _, total = dr.while_loop(
            (start, dr.zeros(Float, len(mean))),
            lambda block, total: block < _COUNT,
            lambda block, total: (block + 1, total + seen(block)),
            label="sum",
        )
        ends = dr.zeros(UInt32, len(mean) * _COUNT)

        def accumulate(block: Any, end: Any) -> tuple[Any, Any]:
            share = dr.gather(Float, blocks.shares, block)
            chance = (1 - evenly) * seen(block) / dr.maximum(total, 1e-30) + evenly * share
            end = end + UInt32(dr.minimum(chance, 1) * (_ROUNDED * _WHOLE))
            last = block == _COUNT - 1
            dr.scatter(ends, dr.select(last, UInt32(_WHOLE - 1), end), pixel * _COUNT + block)
            return block + 1, end

        dr.while_loop((start, start), lambda block, end: block < _COUNT, accumulate, label="accumulate")
        dr.eval(ends)
        return Asked(blocks, ends)

    def choose(self, pixel: Any, number: Any, low_bits: Any) -> tuple[Any, Any]:
        """The block in which a number below 2³² falls, and the share of all light, of 2³², that it stands for there."""
        first = pixel * _COUNT
        number = dr.minimum(number, _WHOLE - 2)

        block = dr.zeros(UInt32, 1)
        for bit in reversed(range(_HALVINGS)):
            higher = block + 2**bit
            block = dr.select(dr.gather(UInt32, self.ends, first + higher - 1) <= number, higher, block)
        begin, width = self._chance(pixel, block)
        inside = dr.minimum((Float(number - begin) + low_bits) / Float(width), 1 - 2**-24)
        light = dr.gather(Float, self.blocks.shares, block) * _WHOLE
        return block, dr.gather(UInt32, self.blocks.first, block) + UInt32(inside * light)

    def preferred(self, pixel: Any, block: Any) -> Any:
        """By how much oftener a direction of that block is drawn than by the light alone."""
        _, width = self._chance(pixel, block)
        share = dr.gather(Float, self.blocks.shares, block)
        return Float(width) * 2**-32 / dr.maximum(share, 1e-30)

    def _chance(self, pixel: Any, block: Any) -> tuple[Any, Any]:
        """Where a block's chance begins, and how much it is, of 2³²."""
        at = pixel * _COUNT + block
        begin = dr.select(block == 0, 0, dr.gather(UInt32, self.ends, dr.select(block == 0, at, at - 1)))
        return begin, dr.gather(UInt32, self.ends, at) - begin


def _seen(blocks: FusedBlocks, axes: list[Any], alpha: Any, block: Any) -> Any:
    """A block's light times the lobe in its direction."""
    (tx, ty, tz, sin_v), (nx, ny, nz, cos_v) = axes
    x, y, z, spread = dr.gather(Array4f, blocks.middles, block)
    along, above = x * tx + y * ty + z * tz, x * nx + y * ny + z * nz
    across = x * (ny * tz - nz * ty) + y * (nz * tx - nx * tz) + z * (nx * ty - ny * tx)
    hx, hz = along + sin_v, above + cos_v
    cos2_h = hz * hz / dr.maximum(hx * hx + across * across + hz * hz, 1e-12)
    alpha2 = alpha * alpha + spread * 0.25
    root = 1 - cos2_h * (1 - alpha2)
    cos_l = dr.clip(above + dr.sqrt(spread), 0, 1)
    unmasked = 2 * cos_l / dr.maximum(cos_l + dr.sqrt(cos_l * cos_l + alpha2 * (1 - cos_l * cos_l)), 1e-12)
    facets = alpha2 / dr.maximum(root * root, 1e-30)
    return dr.select(hz > 0, dr.gather(Float, blocks.shares, block) * facets * unmasked, 0)
