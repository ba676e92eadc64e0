"""Integration of light through microfacet lobes in torch: on any device, in any dtype, without a compiler."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.compute.threads import map_in_threads
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.light_sampling import fresnel_basis
from fit_material.renderer.light_sampling.direction_sampling import (
    Directions,
    LightSampler,
    Points,
    asked_blocks,
    draw_lamps,
    draw_lobe,
)
from fit_material.renderer.light_sampling.integrator import (
    Integration,
    Integrator,
    LobeGrid,
    Progress,
    StratifiedPixels,
)
from fit_material.renderer.rays.local_frame import Frames, frames
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.renderer.rays.pixel_footprint import Places, filled, rays_of, spread_places
from fit_material.shaders.optics import microfacets

_MOST_PIXELS = 10_000_000  # that have random numbers of their own
_CHUNK = 1 << 16  # samples at a time; their some forty intermediate tensors then stay in the cache


@dataclass(frozen=True)
class TorchIntegrator(Integrator):
    """Batched tensors, chunks of pixels in threads; on the environment's device and in its dtype."""

    def integrals(
        self,
        pixels: StratifiedPixels,
        environment: Environment,
        occluder: Occluder | None,
        lobes: LobeGrid,
        integration: Integration,
        progress: Progress,
    ) -> Float[Tensor, "2 a p b 3"]:
        device, samples, seed = environment.radiance.device, integration.samples, integration.seed
        surface, numbers, strata = pixels.surface, pixels.numbers, pixels.strata
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
            for alphas in lobes.groups:
                drawn_at = math.sqrt(alphas[0] * alphas[-1])
                asked = asked_blocks(sampler, rays, drawn_at)
                from_lobe, from_lamps = (
                    _moments(_shares(frame, drawn, drawn_at, alphas, lobes.distribution), drawn, integration.degree)
                    for drawn in (
                        draw_lobe(sampler, frame, drawn_at, asked, u1, u2, free),
                        draw_lamps(sampler, frame, asked, generator, free),
                    )
                )
                made.append((from_lobe + from_lamps).cpu())
            return torch.cat(made, 1)

        chunks = []
        for chunk in map_in_threads(integrate, range(0, len(pixels), step)):
            chunks.append(chunk)
            progress(min(1.0, len(chunks) * step / len(pixels)))
        return torch.cat(chunks, 2)


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
