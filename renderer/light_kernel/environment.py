"""The surroundings in Dr.Jit's terms: looked up by direction, and drawn from in proportion to their light.

What `environment.latlong` and `light_sampling.environment_sampling` do in torch, inside a kernel: the same
interpolation, the same density.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import torch
from drjit.llvm import Array4f, Float, UInt32

from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.light_kernel.product_sampling import FusedBlocks
from fit_material.renderer.light_sampling import environment_sampling

_WHOLE = 2**32  # the sum of all light, in fixed point
_IN_TEXEL = 2**12  # steps along each side of a texel, by which its share of the light is divided further


class Looked(NamedTuple):
    """Radiance per channel, the density per steradian with which the light draws such directions, and their block."""

    radiance: tuple[Any, Any, Any]
    density: Any
    block: Any


@dataclass(frozen=True)
class FusedLight:
    """An environment's arrays.

    Attributes:
        texels: red, green, blue and sampling density of each texel, [(h + 2) · (w + 2) · 4], with a border.
        limits: light up to and including each texel along the Z-order curve, of 2³²; the last is 2³² - 1.
        order: those texels' row · 2¹⁶ + column, for division is dear.
        guide: for each of 2^(32 - guide_shift) equal parts of the light, and the end, the place where it begins.
        rows: of each row, cosine of its upper edge and difference to that of its lower one.
        turn: rotation, as a share of a full turn.
        blocks: of texels.
    """

    texels: Float
    limits: UInt32
    order: UInt32
    guide: UInt32
    rows: Float
    guide_shift: UInt32
    width: UInt32
    height: UInt32
    turn: Float
    blocks: FusedBlocks

    def at(self, x: Any, y: Any, z: Any) -> Looked:
        """Radiance and density in unit directions in world space, as `latlong.lookup` has them."""
        u = dr.atan2(x, -z) * (0.5 / math.pi) + self.turn
        v = dr.atan2(dr.sqrt(x * x + z * z), y) * (1 / math.pi)  # `latlong.polar_angle`
        column, row = (u - dr.floor(u)) * Float(self.width), v * Float(self.height - 1) + 0.5
        texel = (dr.minimum(UInt32(number), size - 1) for number, size in ((row, self.height), (column, self.width)))
        return self._bilinear(column + 0.5, row + 0.5, self.blocks.at(*texel))

    def draw(self, share: Any, block: Any, low_bits: tuple[Any, Any]) -> tuple[tuple[Any, Any, Any], Looked, Any]:
        """Directions drawn in proportion to the light, evenly over a texel; Z-order goes on inside it.

        Args:
            share: of all light, along the Z-order curve, as an unsigned integer below 2³².
            block: in which that is.
            low_bits: two further uniform numbers in [0, 1), for the digits below those of `share`.

        Returns:
            unit directions in world space, the radiance there, and the density per steradian really drawn.
        """
        share = dr.minimum(share, _WHOLE - 2)  # below the last limit
        place = self._texel(share)
        begin = dr.select(place == 0, 0, dr.gather(UInt32, self.limits, dr.maximum(place, 1) - 1))
        width = Float(dr.gather(UInt32, self.limits, place) - begin)
        digits = UInt32(dr.minimum((Float(share - begin) + low_bits[0]) / width, 1 - 2**-24) * _IN_TEXEL**2)
        across = (Float(_compact_bits(digits)) + low_bits[1]) * (1 / _IN_TEXEL)
        down = (Float(_compact_bits(digits >> 1)) + low_bits[0]) * (1 / _IN_TEXEL)

        texel = dr.gather(UInt32, self.order, place)
        row = texel >> 16
        column = Float(texel & 0xFFFF) + across
        edge = dr.gather(dr.llvm.Array2f, self.rows, row)
        y = dr.fma(-down, edge[1], edge[0])
        sin, cos = dr.sincos(2 * math.pi * (column / Float(self.width) - self.turn))
        radius = dr.sqrt(dr.maximum((1 - y) * (1 + y), 0))
        v = dr.acos(dr.clip(y, -1, 1)) * (1 / math.pi)
        looked = self._bilinear(column + 0.5, v * Float(self.height - 1) + 1, block)
        drawn = width * Float(self.width) / (edge[1] * (2 * math.pi * _WHOLE))
        return (radius * sin, y, -radius * cos), looked, drawn

    def _bilinear(self, column: Any, row: Any, block: Any) -> Looked:
        """Texels around a place whose whole numbers are the texels' middles, border included."""
        left, top = UInt32(column), UInt32(row)
        right, lower = column - Float(left), row - Float(top)
        stride = self.width + 2
        at = top * stride + left
        upper_left, upper_right, lower_left, lower_right = (
            dr.gather(Array4f, self.texels, at + step) for step in (0, 1, stride, stride + 1)
        )
        above, below = dr.lerp(upper_left, upper_right, right), dr.lerp(lower_left, lower_right, right)
        found = dr.lerp(above, below, lower)
        return Looked((found[0], found[1], found[2]), found[3], block)

    def _texel(self, share: Any) -> Any:
        """Place on the curve of the first texel whose light ends beyond `share`."""
        part = share >> self.guide_shift
        first, last = dr.gather(UInt32, self.guide, part), dr.gather(UInt32, self.guide, part + 1)

        def halve(first: Any, last: Any) -> tuple[Any, Any]:
            middle = (first + last) >> 1
            before = dr.gather(UInt32, self.limits, middle) <= share
            return dr.select(before, middle + 1, first), dr.select(before, last, middle)

        return dr.while_loop((first, last), lambda first, last: first < last, halve, label="texel")[0]


def fused_light(environment: Environment) -> FusedLight:
    """The arrays of an environment; those of the last one are kept, for a fit uses one after another."""
    return _fused_light(environment, environment.radiance._version)


@functools.lru_cache(maxsize=1)
def _fused_light(environment: Environment, _version: int) -> FusedLight:
    """Arrays of an environment, cached by its tensor and the tensor's version."""
    sampler = environment_sampling.build(environment)
    texels = latlong.of(environment, sampler.density.reshape(environment.radiance.shape[:2])).texels
    limits = (sampler.cumulative * _WHOLE).round().clamp_max(_WHOLE - 1).long()
    bits = max(1, (len(limits) - 1).bit_length())
    parts = torch.arange(2**bits + 1) << (32 - bits)
    guide = torch.searchsorted(limits, parts, right=True).clamp_max(len(limits) - 1)
    order = sampler.order // sampler.width << 16 | sampler.order % sampler.width
    edges = latlong.row_edges(sampler.height).cos()
    rows = torch.stack([edges[:-1], -edges.diff()], 1)
    limits, order, guide = (UInt32(table.numpy().astype("uint32")) for table in (limits, order, guide))
    shift, width, height = (dr.opaque(UInt32, number) for number in (32 - bits, sampler.width, sampler.height))
    texels, rows = (Float(table.flatten().float().numpy()) for table in (texels[0].permute(1, 2, 0), rows))
    turn, blocks = dr.opaque(Float, sampler.rotation / 360), FusedBlocks.of(sampler.blocks)
    return FusedLight(texels, limits, order, guide, rows, shift, width, height, turn, blocks)


def _compact_bits(value: Any) -> Any:
    """Each bit 2b of a number moved to bit b: the inverse of the Z-order curve's interleaving [Morton 1966]."""
    value = value & 0x55555555
    for shift, mask in ((1, 0x33333333), (2, 0x0F0F0F0F), (4, 0x00FF00FF), (8, 0x0000FFFF)):
        value = (value | (value >> shift)) & mask
    return value
