"""Directions drawn by a pixel's lobe and by its surroundings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.environment.latlong import LatLong
from fit_material.renderer.light_sampling import environment_sampling, product_sampling
from fit_material.renderer.light_sampling.environment_sampling import EnvironmentSampler
from fit_material.renderer.rays.local_frame import Frames, frames
from fit_material.renderer.rays.pixel_footprint import FEW, Rays
from fit_material.shaders.optics import microfacets

Free = Callable[[tuple[Tensor, ...]], Float[Tensor, "p s"]]
"""Of unit world directions, x, y, z: 1 where the light from there arrives, 0 where something stands before it."""


@dataclass(frozen=True)
class LightSampler:
    """An environment to look up, its sampling density as the fourth channel, and to draw directions from."""

    light: LatLong
    lamps: EnvironmentSampler

    @staticmethod
    def of(environment: Environment) -> LightSampler:
        density = latlong.of(environment, environment_sampling.sampling_density(environment))
        return LightSampler(density, environment_sampling.build(environment))


@dataclass(frozen=True)
class Points:
    """The Sobol points of the lobe's samples: two numbers for the direction, a third for the ray of the footprint.

    Attributes:
        u: in [0, 1), one half after the other.
        rays: of each pixel.
    """

    u: Float[Tensor, "s 3"]
    rays: int

    @staticmethod
    def draw(samples: int, rays: int, seed: int, like: Tensor) -> Points:
        return Points(torch.quasirandom.SobolEngine(3, scramble=True, seed=seed).draw(samples).to(like), rays)

    @property
    def rays_of_half(self) -> int:
        """One half of the samples takes one half of the rays, where there are enough for two sets."""
        return self.rays if self.rays < FEW else self.rays // 2

    def shifted(
        self, pixels: int, generator: torch.Generator
    ) -> tuple[Float[Tensor, "p s"], Float[Tensor, "p s"], Int[Tensor, "p s"]]:
        """u1, u2 and the ray, each half of each pixel's points shifted by itself [Cranley & Patterson 1976].

        So errors are each pixel's own. That goes for the ray, too: so many points do not meet all rays equally often,
        and if they met the same ones more often in every pixel, the whole picture would be a little displaced.
        """
        half, own = len(self.u) // 2, self.rays_of_half
        shift = torch.rand(pixels, 2, 3, generator=generator, device=generator.device, dtype=self.u.dtype)
        u1, u2, u3 = ((self.u + shift.repeat_interleave(half, 1)) % 1).unbind(-1)
        second = (torch.arange(len(self.u), device=u3.device) >= half) * (self.rays - own)
        return u1, u2, (u3 * own).long().clamp_max(own - 1) + second


@dataclass(frozen=True)
class Directions:
    """Sampled directions to the light.

    Attributes:
        cos_l, cos_h: cosines of light and half vector against the normal.
        sin2_h: squared sine of the half vector's angle, which a narrow lobe's cosine does not resolve.
        cos_d: cosine of the half vector against the view.
        radiance: of the environment.
        lamp_density: density with which the environment draws such directions, interpolated between texels.
        oversampling: density really drawn, over `lamp_density`; None for directions that the lobe drew.
    """

    cos_l: Float[Tensor, "p s"]
    cos_h: Float[Tensor, "p s"]
    sin2_h: Float[Tensor, "p s"]
    cos_d: Float[Tensor, "p s"]
    radiance: Float[Tensor, "p s 3"]
    lamp_density: Float[Tensor, "p s"]
    oversampling: Float[Tensor, "p s"] | None


def draw_lobe(
    sampler: LightSampler,
    frame: Frames,
    alpha: float,
    asked: Float[Tensor, "p k"],
    u1: Float[Tensor, "p s"],
    u2: Float[Tensor, "p s"],
    free: Free | None = None,
) -> Directions:
    """Directions that the lobe of this α draws; `asked` are the chances of `lamp_blocks`."""
    hx, hy, hz = microfacets.sample_visible_normals(frame.cos_v, alpha, u1, u2)
    cos_d = (frame.sin_v * hx + frame.cos_v * hz).clamp(0, 1)
    cos_l = 2 * cos_d * hz - frame.cos_v
    world = frame.to_world(2 * cos_d * hx - frame.sin_v, 2 * cos_d * hy, cos_l)
    found = latlong.lookup(sampler.light, *world)
    block = sampler.lamps.blocks.at(*environment_sampling.texels(sampler.lamps, *world))
    radiance = found[..., :3] if free is None else found[..., :3] * free(world)[..., None]
    density = found[..., 3] * _preferred(sampler, asked, block)
    return Directions(cos_l, hz, hx**2 + hy**2, cos_d, radiance, density, None)


def draw_lamps(
    sampler: LightSampler,
    frame: Frames,
    asked: Float[Tensor, "p k"],
    generator: torch.Generator,
    free: Free | None = None,
) -> Directions:
    """Directions that the light draws, each half of them from strata of its own."""
    pixels, samples = frame.cos_v.shape
    stratum = torch.arange(samples // 2, device=generator.device).repeat(2)
    u, u1, u2 = torch.rand(3, pixels, samples, generator=generator, device=generator.device, dtype=frame.cos_v.dtype)
    block, inside = _choose(asked, (stratum + u) / (samples // 2))
    blocks = sampler.lamps.blocks
    share = blocks.first[block] + inside * blocks.share[block]
    x, y, z, density = environment_sampling.sample(sampler.lamps, share, u1, u2)
    found = latlong.lookup(sampler.light, x, y, z)
    lx, ly, lz = frame.to_local(x, y, z)
    hx, hy, hz = lx + frame.sin_v, ly, lz + frame.cos_v
    scale = torch.rsqrt((hx**2 + hy**2 + hz**2).clamp_min(1e-12))
    cos_h = (hz * scale).clamp(1e-6, 1)  # below the horizon nothing is counted; the bound keeps tan θ finite
    cos_d = ((frame.sin_v * hx + frame.cos_v * hz) * scale).clamp(0, 1)
    sin2_h, told = (hx**2 + hy**2) * scale**2, found[..., 3]
    radiance = found[..., :3] if free is None else found[..., :3] * free((x, y, z))[..., None]
    preferred = told * _preferred(sampler, asked, block)
    return Directions(lz, cos_h, sin2_h, cos_d, radiance, preferred, density / told)


def asked_blocks(sampler: LightSampler, rays: Rays, alpha: float) -> Float[Tensor, "p k"]:
    """The chances of `lamp_blocks`, of pixels whose rays are given, in the dtype of the blocks' directions."""
    blocks = sampler.lamps.blocks
    mean = frames(rays.mean, torch.tensor([0], device=rays.normal.device), blocks.towards.dtype)
    towards = mean.to_local(*(blocks.towards[None, :, i] for i in range(3)))
    width = product_sampling.width(alpha, rays.tilt).to(blocks.towards.dtype)[:, None]
    return product_sampling.chances(blocks, mean.cos_v, mean.sin_v, towards, width)


def _choose(asked: Float[Tensor, "p k"], u: Float[Tensor, "p s"]) -> tuple[Tensor, Tensor]:
    """The block in which each number of [0, 1) falls, and where in it, of [0, 1), float64."""
    end = asked.double().cumsum(1)
    end = end / end[:, -1:]
    u = u.double().clamp_max(1 - 1e-9)
    block = torch.searchsorted(end, u, right=True).clamp_max(asked.shape[1] - 1)
    width = torch.gather(asked.double(), 1, block)
    inside = 1 - (torch.gather(end, 1, block) - u) / width.clamp_min(1e-300)
    return block, inside.clamp(0, 1 - 1e-9)


def _preferred(sampler: LightSampler, asked: Float[Tensor, "p k"], block: Tensor) -> Float[Tensor, "p s"]:
    """By how much oftener a direction of that block is drawn than by the light alone."""
    share = sampler.lamps.blocks.share.float().clamp_min(torch.finfo(torch.float32).tiny)
    return torch.gather(asked / share, 1, block)
