"""Light tables: the light that each pixel receives through its lobe, integrated once, for every roughness and metal.

    radiance(pixel) = Σ_a Σ_b  w_a(roughness) · f_b(n, k) · table[a, pixel, b]

The reflectance of a facet, F(cos_d), is expanded in the few functions of `reflectance_basis`; the table holds the
light weighted by each of them at a few roughnesses. What depends on the material is then only the f_b, found from
F at a few angles, and the interpolation weights w_a: a fit may ask for thousands of materials at no cost.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.compute import chebyshev
from fit_material.renderer.compute.threads import map_in_threads
from fit_material.renderer.environment import cubemap, latlong
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.environment.latlong import LatLong
from fit_material.renderer.light_kernel.table import fused_available, integrate_fused
from fit_material.renderer.light_sampling import fresnel_basis
from fit_material.renderer.light_sampling.direction_sampling import (
    Directions,
    LightSampler,
    Points,
    asked_blocks,
    draw_lamps,
    draw_lobe,
)
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.local_frame import Frames, frames
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.renderer.rays.pixel_footprint import Places, filled, rays_of, spread_places, strata_of
from fit_material.shaders.materials.widths import Blur, Microfacet, Width
from fit_material.shaders.optics import blur, microfacets

Progress = Callable[[float], None]

_MOST_PIXELS = 10_000_000  # that have random numbers of their own
_CHUNK = 1 << 16  # samples at a time; their some forty intermediate tensors then stay in the cache
ROUNDED = 2.0  # units in the last place between the sums of two processors
SHARED_SPAN = 1.6  # factor between the roughnesses that share directions: their weights differ by its square at most


@dataclass(frozen=True)
class LightTable:
    """The light of a set of pixels.

    Attributes:
        light: [2, a, p, b, 3]; two halves of the samples, roughness level, pixel, function of the basis, channel.
        low, high: the range of roughness that the levels span.
        scale: whether the levels are Chebyshev nodes in the roughness or in its logarithm.
        lobe: which roughness it is.
    """

    light: Float[Tensor, "2 a p b 3"]
    low: float
    high: float
    scale: Literal["linear", "log"]
    lobe: type[Width] = Microfacet

    @property
    def roughnesses(self) -> list[float]:
        """Of the levels."""
        return levels(self.low, self.high, self.light.shape[1], self.scale)

    def half(self, which: int) -> LightTable:
        """The table of one half of the samples: what another, cheaper integration would have found."""
        return replace(self, light=self.light[which : which + 1])

    def rounded(self) -> LightTable:
        """The table as another processor might have rounded it: sums in another order, other instructions."""
        generator = torch.Generator().manual_seed(0)
        up = torch.rand(self.light.shape[:3], generator=generator) < 0.5
        step = ROUNDED * torch.finfo(self.light.dtype).eps * (2 * up.to(self.light) - 1)
        return replace(self, light=self.light * (1 + step[..., None, None]))

    def without_highest(self) -> LightTable:
        """The table with its light less the amplitude of the highest polynomial through the levels.

        What a smooth curve loses to its interpolation is less than that.
        """
        return replace(self, light=self.light - chebyshev.coefficients(self.light.movedim(1, 0))[-1][:, None])

    def mean(self, dtype: torch.dtype) -> Float[Tensor, "a p b 3"]:
        """Both halves together."""
        return self.light.to(dtype).mean(0)

    def level_weights(self, roughness: Float[Tensor, ""]) -> Float[Tensor, " a"]:
        """w_a, interpolation weights of the roughness levels; beyond the range the nearest end's."""
        low, high = (_on_scale(roughness.new_tensor(end), self.scale) for end in (self.low, self.high))
        position = (_on_scale(roughness.clamp(self.low, self.high), self.scale) - low) / (high - low)
        return chebyshev.weights(2 * position - 1, self.light.shape[1])


def radiance(
    light: Float[Tensor, "a p b 3"], level_weights: Float[Tensor, " a"], coefficients: Float[Tensor, "b c"]
) -> Float[Tensor, "p 3"]:
    """The radiance of each pixel, from a table's mean, roughness weights w_a and Fresnel coefficients f_b."""
    at_roughness = torch.tensordot(level_weights, light, dims=1)
    return (at_roughness * coefficients).sum(1)


def levels(low: float, high: float, count: int, scale: Literal["linear", "log"]) -> list[float]:
    """Chebyshev nodes of roughness between `low` and `high`, ends included."""
    ends = torch.tensor([low, high], dtype=torch.float64)
    first, last = _on_scale(ends, scale)
    spread = first + (chebyshev.nodes(count) + 1) / 2 * (last - first)
    return (spread.exp() if scale == "log" else spread).tolist()


def microfacet_table(
    surface: GBuffer,
    environment: Environment,
    alphas: tuple[float, float, int],
    *,
    distribution: microfacets.Distribution,
    degree: int,
    samples: int,
    seed: int,
    progress: Progress = lambda share: None,
    fused: bool | None = None,
    occluder: Occluder | None = None,
) -> LightTable:
    """Light through a GGX or Beckmann lobe with Smith shadowing, from above the horizon.

    Half of the directions are drawn from the lobe (visible normals at Sobol points, [Heitz 2018]), half from the
    environment, by the blocks of light that the lobe shows bright (`lamp_blocks`); the balance heuristic [Veach 1997,
    eq. 9.8] joins them. The samples walk over the pixel as they walk through the lobe. No lookup is filtered: the mean
    of the table is the exact light. Its halves are independent.

    Args:
        surface: [p, k] rays inside each of p pixels, all on the front of the object.
        environment: the light; the integration runs on its device and in its dtype.
        alphas: lowest and highest microfacet width, and the number of levels between them.
        distribution: "ggx" or "beckmann".
        degree: number of functions in the reflectance basis.
        samples: directions per pixel and level, a multiple of 4.
        seed: of the shifts; the same seed gives the same table.
        progress: told the share that is done, in (0, 1].
        fused: whether one compiled kernel does it, see `light_kernel.table`; by default where it can, on the CPU in
            float32.
        occluder: what may stand before the light, which then does not count; None where nothing does.

    Returns:
        the table, on the CPU.
    """
    groups = _neighbours(levels(*alphas, "log"))
    if fused is None:
        fused = _fits_the_kernel(environment.radiance) and fused_available()
        fused = fused and (occluder is None or occluder.compiled is not None)
    integrate = integrate_fused if fused else _integrate
    table, done = torch.empty(2, alphas[2], len(surface.hit), degree, 3, dtype=environment.radiance.dtype), 0
    needed = strata_of(surface, alphas[0], samples)
    for strata in needed.unique().tolist():
        chosen = (needed == strata).nonzero()[:, 0]
        table[:, :, chosen] = integrate(
            surface[chosen],
            chosen,
            environment,
            groups,
            strata=strata,
            distribution=distribution,
            degree=degree,
            samples=samples,
            seed=seed,
            occluder=occluder,
            progress=_part_of(progress, done / len(needed), len(chosen) / len(needed)),
        )
        done += len(chosen)
    return LightTable(table, *alphas[:2], "log")


def _part_of(progress: Progress, begun: float, share: float) -> Progress:
    """Progress of a share of the work, after what was begun."""
    return lambda part: progress(begun + share * part)


def _integrate(
    surface: GBuffer,
    numbers: Int[Tensor, " p"],
    environment: Environment,
    groups: list[list[float]],
    *,
    strata: int,
    distribution: microfacets.Distribution,
    degree: int,
    samples: int,
    seed: int,
    progress: Progress,
    occluder: Occluder | None = None,
) -> Float[Tensor, "2 a p b 3"]:
    """The table's light in torch, on the environment's device; for the arguments see `fused_table.integrate_fused`."""
    pixels, device = len(surface.hit), environment.radiance.device
    sampler = LightSampler.of(environment)
    points = Points.draw(samples // 2, rays_of(surface, strata), seed, environment.radiance)
    places, step = Places.draw(numbers, strata, seed), max(1, _CHUNK // samples)

    def integrate(start: int) -> Float[Tensor, "2 a c b 3"]:
        part = surface[start : start + step]
        generator = torch.Generator(device).manual_seed(seed * _MOST_PIXELS + int(numbers[start]))
        place = places[start : start + step]
        rays = filled(part, place).to(device)
        u1, u2, ray = points.shifted(len(place), generator)
        frame = frames(rays, ray, u1.dtype)
        free = None
        if occluder is not None:
            pixel = torch.arange(len(place))[:, None]
            free = occluder.before(spread_places(occluder.origins(part), place)[pixel, ray.cpu()])
        made = []
        for alphas in groups:
            drawn_at = math.sqrt(alphas[0] * alphas[-1])
            asked = asked_blocks(sampler, rays, drawn_at)
            from_lobe, from_lamps = (
                _moments(_shares(frame, drawn, drawn_at, alphas, distribution), drawn, degree)
                for drawn in (
                    draw_lobe(sampler, frame, drawn_at, asked, u1, u2, free),
                    draw_lamps(sampler, frame, asked, generator, free),
                )
            )
            made.append((from_lobe + from_lamps).cpu())
        return torch.cat(made, 1)

    chunks = []
    for chunk in map_in_threads(integrate, range(0, pixels, step)):
        chunks.append(chunk)
        progress(min(1.0, len(chunks) * step / pixels))
    return torch.cat(chunks, 2)


def tap_table(surface: GBuffer, environment: Cubemap, rhos: tuple[float, float, int]) -> LightTable:
    """Light through the thesis's 49 taps around the mirrored view [MODEL.md 3.1]; its only degree is 0.

    Args:
        surface: [p] rays.
        environment: the cubemap that the viewer would read.
        rhos: lowest and highest blur radius, and the number of levels between them.

    Returns:
        the table; its two halves are equal, for the taps are the model and no estimate.
    """
    low, high, count = rhos
    reflected = reflect(surface).to(environment.faces)
    radiance = functools.partial(cubemap.lookup, environment)
    table = torch.stack(
        [blur.blur(radiance, reflected, reflected.new_tensor(rho)) for rho in levels(low, high, count, "linear")]
    )
    return LightTable(table[:, :, None].expand(2, *table.shape[:2], 1, 3), low, high, "linear", Blur)


def gaussian_table(
    surface: GBuffer, environment: Environment, rhos: tuple[float, float, int], samples: int, seed: int
) -> LightTable:
    """Light through the lobe that the thesis's 49 taps stand for, converged [MODEL.md 6]; its only degree is 0.

    Args:
        surface: [p] rays.
        environment: the light, on the CPU; the table has its dtype.
        rhos: lowest and highest blur radius, and the number of levels between them.
        samples: directions per pixel and level, even; one half for each half of the table.
        seed: of the offsets; the same seed gives the same table.
    """
    low, high, count = rhos
    light, reflected = latlong.of(environment), reflect(surface).to(environment.radiance)
    offsets = blur.gaussian_offsets(samples // 2, seed, reflected)
    step = max(1, _CHUNK // samples)

    def integrate(start: int) -> Float[Tensor, "2 a c 3"]:
        part = reflected[start : start + step]
        return torch.stack(
            [
                torch.stack([_mean_light(light, part, half, rho) for rho in levels(low, high, count, "linear")])
                for half in offsets
            ]
        )

    table = torch.cat(list(map_in_threads(integrate, range(0, len(reflected), step))), 2)
    return LightTable(table[:, :, :, None], low, high, "linear", Blur)


def _mean_light(light: LatLong, r: Float[Tensor, "p 3"], offsets: Float[Tensor, "s 2"], rho: float) -> Tensor:
    """Mean light of the Gaussian lobe of ρ around r, [p, 3]."""
    towards = blur.gaussian_directions(r, offsets, rho)
    return latlong.lookup(light, *towards.unbind(-1)).mean(1)


def _fits_the_kernel(radiance: Tensor) -> bool:
    """The compiled kernel runs on the CPU, in float32."""
    return radiance.device.type == "cpu" and radiance.dtype == torch.float32


def reflect(surface: GBuffer) -> Float[Tensor, "*p 3"]:
    """r = 2(n·v)n - v, the mirrored view."""
    return 2 * surface.n_dot_v[..., None] * surface.normal - surface.view


def _on_scale(roughness: Tensor, scale: Literal["linear", "log"]) -> Tensor:
    return roughness.log() if scale == "log" else roughness


def _neighbours(alphas: list[float]) -> list[list[float]]:
    """Ascending roughnesses in groups that are near enough to share directions."""
    groups: list[list[float]] = []
    for alpha in alphas:
        if groups and alpha <= groups[-1][0] * SHARED_SPAN:
            groups[-1].append(alpha)
        else:
            groups.append([alpha])
    return groups


def _shares(
    frame: Frames, drawn: Directions, drawn_at: float, alphas: list[float], distribution: microfacets.Distribution
) -> Float[Tensor, "a p s"]:
    """What the light of each direction counts in each lobe, times the number of directions.

    With p_b and p_e the densities of lobe and environment, drawn equally often, every direction counts
    f / (p_b + p_e), whoever drew it, f being BRDF · cosine without the reflectance. The sum stays exact with an
    interpolated p_e as long as both kinds of directions use it and the one drawn from the environment is divided by
    the density really drawn.
    """
    cosines = frame.cos_v, drawn.cos_l, drawn.cos_h
    density = microfacets.visible_normal_density(frame.cos_v, drawn.cos_h, drawn_at, drawn.sin2_h) + drawn.lamp_density
    if drawn.oversampling is not None:
        density = density * drawn.oversampling
    return torch.stack(
        [microfacets.reflected(*cosines, alpha, distribution, drawn.sin2_h) / density for alpha in alphas]
    )


def _moments(shares: Float[Tensor, "a p s"], drawn: Directions, degree: int) -> Float[Tensor, "2 a p b 3"]:
    """Means of the reflectance basis times light over each half of the samples."""
    count, pixels, samples = shares.shape
    light = (shares[..., None] * drawn.radiance).permute(1, 2, 0, 3).reshape(pixels, samples, -1)
    basis = fresnel_basis.basis(drawn.cos_d, degree).permute(1, 0, 2)
    halves = (slice(0, samples // 2), slice(samples // 2, samples))
    found = torch.stack([torch.bmm(basis[:, :, half], light[:, half]) / (samples // 2) for half in halves])
    return found.reshape(2, pixels, degree, count, 3).permute(0, 3, 1, 2, 4)
