"""Random numbers inside a Dr.Jit kernel, each a function of pixel, sample and seed alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import torch
from drjit.llvm import Array4f, Float, UInt32
from jaxtyping import Int
from torch import Tensor

from fit_material.renderer.light_sampling.direction_sampling import Points


@dataclass(frozen=True)
class Draws:
    """The numbers by which one half of the samples of one pixel is drawn.

    Attributes:
        points: the lobe's Sobol points of three numbers, and a filler: a kernel fetches four at once.
        rays: of one half of the samples, and where they begin.
        count: of each kind of directions in one half.
        stratum: 2³² over the number of one half's directions from the light, each of which has its own part of it.
        half: 0 or 1.
        pixel: number of the pixel.
        seed: of all numbers.
    """

    points: Float
    rays: tuple[Any, Any]
    count: Any
    stratum: Any
    half: Any
    pixel: Any
    seed: Any

    @staticmethod
    def of(numbers: Int[Tensor, " t"], half: Any, samples: int, rays: int, seed: int) -> Draws:
        """Those of the pixels with these numbers, one for each thread."""
        points = Points.draw(samples // 2, rays, seed, torch.zeros(0))
        packed = torch.nn.functional.pad(points.u, (0, 1))
        count, stratum = (
            dr.opaque(UInt32, number) for number in (samples // 4, min(2**32 - 1, 2**32 // (samples // 4)))
        )
        own = dr.opaque(UInt32, points.rays_of_half)
        begin = half * dr.opaque(UInt32, rays - points.rays_of_half)
        pixel = UInt32(numbers.numpy().astype("uint32"))
        drawn = Float(packed.flatten().numpy())
        return Draws(drawn, (own, begin), count, stratum, half, pixel, dr.opaque(UInt32, seed % 2**32))

    def lobe(self, i: Any) -> tuple[Any, Any, Any]:
        """u1, u2 and the ray of the lobe's sample i, shifted by half and pixel; see `Points.shifted`."""
        *point, _ = dr.gather(Array4f, self.points, self.half * self.count + i)
        shifts = hashed(self.pixel, UInt32(2**32 - 1) - self.half, self.seed)
        shifted = (number + _unit(shift) for number, shift in zip(point, shifts, strict=True))
        u1, u2, u3 = (number - dr.floor(number) for number in shifted)
        own, begin = self.rays
        return u1, u2, begin + dr.minimum(UInt32(u3 * Float(own)), own - 1)

    def light(self, i: Any) -> tuple[Any, tuple[Any, Any]]:
        """Where in the pixel's light, of 2³², the light's sample i lies, and two numbers in [0, 1) for the rest.

        Each half has strata of its own, so that its error is its own as well.
        """
        jitter, u1, u2 = hashed(self.pixel, 2 * i + self.half, self.seed)
        return i * self.stratum + _share(jitter, self.stratum), (_unit(u1), _unit(u2))


def hashed(x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    """Three independent integers below 2³² from three: pcg3d [Jarzynski & Olano 2020]."""
    x, y, z = _mixed(*(UInt32(value) * 1664525 + 1013904223 for value in (x, y, z)))
    return _mixed(*(value ^ (value >> 16) for value in (x, y, z)))


def _mixed(x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    x = x + y * z
    y = y + z * x
    return x, y, z + x * y


def _share(number: Any, whole: Any) -> Any:
    """A random integer below 2³² brought into the range below another."""
    return dr.mul_hi(number, whole)


def _unit(number: Any) -> Any:
    return Float(number) * 2**-32
