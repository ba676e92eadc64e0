"""The kernel of `renderer.light_kernel.llvm_integrator`: the sums over one half of the samples of one pixel."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import torch
from drjit.llvm import Array3f, Array4f, Float, UInt32
from jaxtyping import Float as Floats
from jaxtyping import Int as Ints
from torch import Tensor

from fit_material.renderer.light_kernel.environment import FusedLight, Looked
from fit_material.renderer.light_kernel.microfacets import (
    View,
    reflected,
    sample_visible_normals,
    visible_normal_density,
)
from fit_material.renderer.light_kernel.occlusion import Blocked
from fit_material.renderer.light_kernel.packed_rays import PackedRays
from fit_material.renderer.light_kernel.product_sampling import Asked
from fit_material.renderer.light_kernel.random_numbers import Draws
from fit_material.renderer.light_sampling import product_sampling
from fit_material.renderer.light_sampling.fresnel_basis import BEND
from fit_material.renderer.light_sampling.product_sampling import EVEN
from fit_material.shaders.optics.microfacets import Distribution

Free = Callable[[Array3f], Any]
"""Whether light from a direction arrives."""

EVENLY = 0.5  # fraction of the directions drawn by the light alone, where they serve roughnesses far apart


@dataclass(frozen=True)
class Frame:
    """The axes of one ray's local frame, in which the view lies in the xz plane, and the view."""

    tangent: Array3f
    bitangent: Array3f
    normal: Array3f
    view: View

    @staticmethod
    def fetch(packed: Float, ray: Any) -> Frame:
        first, second = (dr.gather(Array4f, packed, 2 * ray + half) for half in (0, 1))
        tangent, normal = Array3f(*first[:3]), Array3f(*second[:3])
        return Frame(tangent, dr.cross(normal, tangent), normal, View(first[3], second[3]))

    def to_world(self, local: Array3f) -> Array3f:
        return local.x * self.tangent + local.y * self.bitangent + local.z * self.normal

    def to_local(self, world: Array3f) -> Array3f:
        return Array3f(*(dr.dot(world, axis) for axis in (self.tangent, self.bitangent, self.normal)))


@dataclass(frozen=True)
class Directions:
    """Directions to the light: half vector, cosines of light and half vector against normal and view, and the light.

    `density` is that with which the light draws such directions, as the pixel chooses blocks; `oversampling` the one
    really drawn over it, 1 for directions that the lobe drew; `free` whether nothing stands before the light.
    """

    h: Array3f
    cos_l: Any
    cos_d: Any
    looked: Looked
    density: Any
    oversampling: Any
    free: Any = True


@dataclass(frozen=True)
class Group:
    """Roughnesses that share directions, and the one for which these are drawn."""

    drawn_at: Float
    alphas: tuple[Float, ...]

    @staticmethod
    def of(alphas: Sequence[float]) -> Group:
        middle = math.sqrt(alphas[0] * alphas[-1])
        return Group(dr.opaque(Float, middle), tuple(dr.opaque(Float, alpha) for alpha in alphas))


def moments(
    light: FusedLight,
    rays: PackedRays,
    numbers: Ints[Tensor, " p"],
    groups: Sequence[Sequence[float]],
    distribution: Distribution,
    degree: int,
    samples: int,
    seed: int,
    blocked: Blocked | None = None,
) -> Floats[Tensor, "2 a p b 3"]:
    """Means of the reflectance basis times light over each half of the samples, of all roughnesses of the groups.

    Args:
        rays: of the pixels.
        numbers: theirs; a pixel's random numbers follow from its number and the seed alone.
        blocked: what stands before the light; None compiles a kernel without a ray.
    """
    pixels, count = rays.frames.shape[:2]
    packed, per_pixel = Float(rays.frames.flatten().numpy()), dr.opaque(UInt32, count)
    thread = dr.arange(UInt32, 2 * pixels)
    draws = Draws.of(numbers.repeat_interleave(2), thread & 1, samples, count, seed)
    lobes, middle = [Group.of(alphas) for alphas in groups], math.sqrt(groups[0][0] * groups[-1][-1])
    evenly = EVEN if len(groups) == 1 else EVENLY
    asked = Asked.by(light.blocks, rays.mean, product_sampling.width(middle, rays.tilt), evenly)

    def body(i: Any, sums: list[Any]) -> tuple[Any, list[Any]]:
        u1, u2, ray = draws.lobe(i)
        frame = Frame.fetch(packed, (thread >> 1) * per_pixel + ray)
        free = _unhindered if blocked is None else blocked.before((thread >> 1) * per_pixel + ray)
        from_light = _from_light(light, asked, thread >> 1, frame, free, *draws.light(i))
        polar = dr.sqrt(u1), *dr.sincos(2 * math.pi * u2)
        terms = []
        for group in lobes:
            from_lobe = _from_lobe(light, asked, thread >> 1, frame, free, group, polar)
            terms += _terms(from_lobe, from_light, frame.view, group, distribution, degree)
        return i + 1, [total + term for total, term in zip(sums, terms, strict=True)]

    levels = sum(map(len, groups))
    sums = [dr.zeros(Float, 2 * pixels) for _ in range(levels * degree * 3)]
    start = dr.zeros(UInt32, 2 * pixels), sums
    _, sums = dr.while_loop(start, lambda i, sums: i < draws.count, body, label="samples")
    means = [total / Float(draws.count) for total in sums]
    dr.eval(means)
    table = torch.stack([torch.from_numpy(mean.numpy()) for mean in means])
    return table.reshape(levels, degree, 3, pixels, 2).permute(4, 0, 3, 1, 2)


def _unhindered(towards: Array3f) -> bool:
    return True


def _from_lobe(
    light: FusedLight, asked: Asked, pixel: Any, frame: Frame, free: Free, group: Group, polar: tuple[Any, Any, Any]
) -> Directions:
    h = sample_visible_normals(frame.view, group.drawn_at, *polar)
    cos_d = dr.clip(frame.view.sin * h.x + frame.view.cos * h.z, 0, 1)
    local = 2 * cos_d * h - Array3f(frame.view.sin, 0, frame.view.cos)
    towards = frame.to_world(local)
    looked = light.at(*towards)
    density = looked.density * asked.preferred(pixel, looked.block)
    return Directions(h, local.z, cos_d, looked, density, 1, free(towards))


def _from_light(
    light: FusedLight,
    asked: Asked,
    pixel: Any,
    frame: Frame,
    free: Free,
    number: Any,
    low_bits: tuple[Any, Any],
) -> Directions:
    block, share = asked.choose(pixel, number, low_bits[1])
    towards, looked, drawn = light.draw(share, block, low_bits)
    local = frame.to_local(Array3f(*towards))
    h = local + Array3f(frame.view.sin, 0, frame.view.cos)
    h *= dr.rsqrt(dr.maximum(dr.squared_norm(h), 1e-12))
    cos_d = dr.clip(frame.view.sin * h.x + frame.view.cos * h.z, 0, 1)
    density = looked.density * asked.preferred(pixel, block)
    return Directions(h, local.z, cos_d, looked, density, drawn / looked.density, free(Array3f(*towards)))


def _terms(
    from_lobe: Directions,
    from_light: Directions,
    view: View,
    group: Group,
    distribution: Distribution,
    degree: int,
) -> list[Any]:
    """What a direction drawn from the lobe and one from the light add: by roughness, function and channel."""
    first, second = (_weighted(view, drawn, group, distribution) for drawn in (from_lobe, from_light))
    bases = [_basis(drawn.cos_d, degree) for drawn in (from_lobe, from_light)]
    return [
        dr.fma(p, one, q * other)
        for lit in zip(first, second, strict=True)
        for p, q in zip(*bases, strict=True)
        for one, other in zip(*lit, strict=True)
    ]


def _weighted(view: View, drawn: Directions, group: Group, distribution: Distribution) -> list[list[Any]]:
    """The light of a direction in each lobe, by roughness and channel; see `light_table` for the density."""
    density = visible_normal_density(view, drawn.h, group.drawn_at) + drawn.density
    weight = dr.rcp(density * drawn.oversampling)
    above = (drawn.cos_l > 0) & drawn.free
    found = []
    for alpha in group.alphas:
        share = dr.select(above, reflected(view, drawn.cos_l, drawn.h, alpha, distribution) * weight, 0)
        found.append([share * channel for channel in drawn.looked.radiance])
    return found


def _basis(cos_d: Any, count: int) -> list[Any]:
    """As `reflectance_basis.basis` has it."""
    x = 2 * (1 + BEND) * cos_d * dr.rcp(BEND + cos_d) - 1
    values = [Float(1), x]
    while len(values) < count:
        values.append(dr.fma(2 * x, values[-1], -values[-2]))
    return values[:count]
