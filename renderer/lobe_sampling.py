"""Directions in which a pixel's lobe and its surroundings are asked for light."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from renderer import lamps, latlong
from renderer.environment import Environment
from renderer.gbuffer import GBuffer
from renderer.lamps import LampSampler
from renderer.latlong import LatLong
from shaders import lobe

_STRAIGHT = 1e-9  # sine of a view straight down the normal, for which any tangent will do


@dataclass(frozen=True)
class LightSampler:
    """An environment to look up, its sampling density as the fourth channel, and to draw directions from."""

    light: LatLong
    lamps: LampSampler

    @staticmethod
    def of(environment: Environment) -> LightSampler:
        return LightSampler(latlong.of(environment, lamps.sampling_density(environment)), lamps.build(environment))


@dataclass(frozen=True)
class Frames:
    """Per sample: cos_v, sin_v, and the world components of the tangent, bitangent and normal, each [p, s]."""

    cos_v: Float[Tensor, "p s"]
    sin_v: Float[Tensor, "p s"]
    axes: tuple[tuple[Tensor, Tensor, Tensor], ...]

    def to_local(self, x: Tensor, y: Tensor, z: Tensor) -> tuple[Tensor, ...]:
        return tuple(x * axis[0] + y * axis[1] + z * axis[2] for axis in self.axes)

    def to_world(self, x: Tensor, y: Tensor, z: Tensor) -> tuple[Tensor, ...]:
        tangent, bitangent, normal = self.axes
        return tuple(x * t + y * b + z * n for t, b, n in zip(tangent, bitangent, normal, strict=True))


def frames(surface: GBuffer, ray: Tensor) -> Frames:
    """Local frames in which the view lies in the xz plane, for the ray of the footprint that each sample takes."""
    normal, view, cos_v = surface.normal, surface.view, surface.n_dot_v
    tangent = view - cos_v[..., None] * normal
    # From float64: a cosine in float32 does not tell the small angles that a narrow lobe resolves.
    sin_v = tangent.norm(dim=-1)
    tangent = tangent / sin_v[..., None].clamp_min(_STRAIGHT)
    straight = sin_v <= _STRAIGHT
    if straight.any():
        tangent[straight] = _any_tangent(normal[straight])
    bitangent = torch.linalg.cross(normal, tangent)
    axes = tuple(tuple(axis[:, ray, i].float().contiguous() for i in range(3)) for axis in (tangent, bitangent, normal))
    return Frames(cos_v[:, ray].float().clamp(1e-6, 1), sin_v[:, ray].float(), axes)  # type: ignore[arg-type]


def _any_tangent(normal: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
    """Perpendicular to the axis that is the least parallel to each normal."""
    axis = torch.nn.functional.one_hot(normal.abs().argmin(-1), 3).to(normal)
    return torch.nn.functional.normalize(torch.linalg.cross(normal, axis), dim=-1)


@dataclass(frozen=True)
class Points:
    """The Sobol points of the lobe's samples, and the ray of the footprint that each of them takes."""

    u1: Float[Tensor, " s"]
    u2: Float[Tensor, " s"]
    ray: Tensor

    @staticmethod
    def draw(samples: int, rays: int, seed: int, device: torch.device) -> Points:
        u1, u2, u3 = torch.quasirandom.SobolEngine(3, scramble=True, seed=seed).draw(samples).T.to(device)
        return Points(u1, u2, (u3 * rays).long().clamp_max(rays - 1))

    def shifted(self, pixels: int, generator: torch.Generator) -> tuple[Float[Tensor, "p s"], Float[Tensor, "p s"]]:
        """The points under another shift for each pixel [Cranley & Patterson 1976], so that errors average out."""
        shift = torch.rand(2, pixels, 1, generator=generator, device=generator.device)
        return (self.u1 + shift[0]) % 1, (self.u2 + shift[1]) % 1


@dataclass(frozen=True)
class Directions:
    """Sampled directions to the light.

    Attributes:
        cos_l, cos_h: cosines of light and half vector against the normal.
        cos_d: cosine of the half vector against the view.
        radiance: of the environment.
        lamp_density: density with which the environment draws such directions, interpolated between texels.
        oversampling: density really drawn, over `lamp_density`; None for directions that the lobe drew.
    """

    cos_l: Float[Tensor, "p s"]
    cos_h: Float[Tensor, "p s"]
    cos_d: Float[Tensor, "p s"]
    radiance: Float[Tensor, "p s 3"]
    lamp_density: Float[Tensor, "p s"]
    oversampling: Float[Tensor, "p s"] | None


def draw_lobe(
    sampler: LightSampler, frame: Frames, alpha: float, u1: Float[Tensor, "p s"], u2: Float[Tensor, "p s"]
) -> Directions:
    hx, hy, hz = lobe.sample_visible_normals(frame.cos_v, alpha, u1, u2)
    cos_d = (frame.sin_v * hx + frame.cos_v * hz).clamp(0, 1)
    cos_l = 2 * cos_d * hz - frame.cos_v
    world = frame.to_world(2 * cos_d * hx - frame.sin_v, 2 * cos_d * hy, cos_l)
    found = latlong.lookup(sampler.light, *world)
    return Directions(cos_l, hz, cos_d, found[..., :3], found[..., 3], None)


def draw_lamps(sampler: LightSampler, frame: Frames, generator: torch.Generator) -> Directions:
    pixels, samples = frame.cos_v.shape
    stratum = torch.arange(samples, device=generator.device)
    # Odd strata after even ones: each half of the samples then covers all of the light.
    stratum = torch.cat([stratum[0::2], stratum[1::2]])
    u, u1, u2 = torch.rand(3, pixels, samples, generator=generator, device=generator.device)
    x, y, z, density = lamps.sample(sampler.lamps, (stratum + u) / samples, u1, u2)
    found = latlong.lookup(sampler.light, x, y, z)
    lx, ly, lz = frame.to_local(x, y, z)
    hx, hy, hz = lx + frame.sin_v, ly, lz + frame.cos_v
    scale = torch.rsqrt((hx**2 + hy**2 + hz**2).clamp_min(1e-12))
    cos_h = (hz * scale).clamp(1e-6, 1)  # below the horizon nothing is counted; the bound keeps tan θ finite
    cos_d = ((frame.sin_v * hx + frame.cos_v * hz) * scale).clamp(0, 1)
    return Directions(lz, cos_h, cos_d, found[..., :3], found[..., 3], density / found[..., 3])
