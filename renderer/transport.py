"""Light tables: the light that each pixel receives through its lobe, integrated once, for every roughness and metal.

    radiance(pixel) = Σ_a Σ_b  w_a(roughness) · f_b(n, k) · table[a, pixel, b]

The reflectance of a facet, F(cos_d), is expanded in Chebyshev polynomials T_b(2 cos_d - 1); the table holds the
light weighted by each of them at a few roughnesses. What depends on the material is then only the f_b, found from
F at a few angles, and the interpolation weights w_a: a fit may ask for thousands of materials at no cost.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from renderer import chebyshev, cubemap, lamps, latlong
from renderer.cubemap import Cubemap
from renderer.environment import Environment
from renderer.gbuffer import GBuffer
from renderer.lamps import LampSampler
from renderer.latlong import LatLong
from renderer.threads import map_in_threads
from shaders import lobe

Reflectance = Callable[[Float[Tensor, "b 1"]], Float[Tensor, "b c"]]
Progress = Callable[[float], None]

_CHUNK = 1 << 16  # samples at a time; their some forty intermediate tensors then stay in the cache


@dataclass(frozen=True)
class LightTable:
    """The light of a set of pixels.

    Attributes:
        light: [2, a, p, b, 3]; two halves of the samples, roughness level, pixel, Chebyshev degree, channel.
        low, high: the range of roughness that the levels span.
        scale: whether the levels are Chebyshev nodes in the roughness or in its logarithm.
    """

    light: Float[Tensor, "2 a p b 3"]
    low: float
    high: float
    scale: Literal["linear", "log"]

    def half(self, which: int) -> LightTable:
        """The table of one half of the samples: what another, cheaper integration would have found."""
        return LightTable(self.light[which : which + 1], self.low, self.high, self.scale)

    def mean(self, dtype: torch.dtype) -> Float[Tensor, "a p b 3"]:
        """Both halves together."""
        return self.light.to(dtype).mean(0)

    def level_weights(self, roughness: Float[Tensor, ""]) -> Float[Tensor, " a"]:
        """w_a, interpolation weights of the roughness levels; beyond the range the nearest end's."""
        low, high = (_on_scale(roughness.new_tensor(end), self.scale) for end in (self.low, self.high))
        position = (_on_scale(roughness.clamp(self.low, self.high), self.scale) - low) / (high - low)
        return chebyshev.weights(2 * position - 1, self.light.shape[1])


def reflectance_coefficients(reflectance: Reflectance, degree: int, like: Tensor) -> Float[Tensor, "b c"]:
    """f_b with F(cos_d) ≈ Σ_b f_b T_b(2 cos_d - 1), in the dtype of `like`; of one channel where F has one."""
    cos_d = ((chebyshev.nodes(degree) + 1) / 2).to(like)
    return chebyshev.coefficients(reflectance(cos_d[:, None]))


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
    distribution: lobe.Distribution,
    degree: int,
    samples: int,
    seed: int,
    progress: Progress = lambda share: None,
) -> LightTable:
    """Light through a GGX or Beckmann lobe with Smith shadowing, from above the horizon.

    Half of the directions are drawn from the lobe (visible normals at Sobol points, [Heitz 2018]), half from the
    environment; the balance heuristic [Veach 1997, eq. 9.8] joins them. The samples walk through the pixel's
    footprint as they walk through the lobe. No lookup is filtered: the mean of the table is the exact light.

    Args:
        surface: [p, k] rays inside each of p pixels, all on the front of the object.
        environment: the light; the integration runs on its device.
        alphas: lowest and highest microfacet width, and the number of levels between them.
        distribution: "ggx" or "beckmann".
        degree: number of Chebyshev polynomials for the reflectance.
        samples: directions per pixel and level, a multiple of 4.
        seed: of the shifts; the same seed gives the same table.
        progress: told the share that is done, in (0, 1].

    Returns:
        the table, float32, on the CPU.
    """
    low, high, count = alphas
    pixels, device = len(surface.hit), environment.radiance.device
    lamp_sampler = lamps.build(environment)
    light = latlong.of(environment, lamps.sampling_density(environment))
    points = _Points.draw(samples // 2, surface.hit.shape[1], seed, device)
    step = max(1, _CHUNK // samples)

    def integrate(start: int) -> Float[Tensor, "2 a c b 3"]:
        generator = torch.Generator(device).manual_seed(seed * pixels + start)
        frame = _frames(surface[start : start + step].to(device), points.ray)
        u1, u2 = points.shifted(len(frame.cos_v), generator)
        towards_lamps = _draw_lamps(lamp_sampler, light, frame, generator)
        made = []
        for alpha in levels(low, high, count, "log"):
            from_lobe, from_lamps = (
                _moments(_weighted_light(frame, alpha, distribution, drawn), drawn.cos_d, degree)
                for drawn in (_draw_lobe(light, frame, alpha, u1, u2), towards_lamps)
            )
            made.append((from_lobe + from_lamps).cpu())
        return torch.stack(made, 1)

    chunks = []
    for chunk in map_in_threads(integrate, range(0, pixels, step)):
        chunks.append(chunk)
        progress(min(1.0, len(chunks) * step / pixels))
    table = torch.cat(chunks, 2)
    return LightTable(table, low, high, "log")


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
    reflected = reflect(surface).float()
    radiance = functools.partial(cubemap.lookup, environment)
    table = torch.stack(
        [lobe.blur(radiance, reflected, torch.tensor(rho)) for rho in levels(low, high, count, "linear")]
    )
    return LightTable(table[:, :, None].expand(2, *table.shape[:2], 1, 3), low, high, "linear")


def reflect(surface: GBuffer) -> Float[Tensor, "*p 3"]:
    """r = 2(n·v)n - v, the mirrored view."""
    return 2 * surface.n_dot_v[..., None] * surface.normal - surface.view


def _on_scale(roughness: Tensor, scale: Literal["linear", "log"]) -> Tensor:
    return roughness.log() if scale == "log" else roughness


@dataclass(frozen=True)
class _Frames:
    """Per sample: cos_v, and the world components of the tangent, bitangent and normal, each [p, s]."""

    cos_v: Float[Tensor, "p s"]
    axes: tuple[tuple[Tensor, Tensor, Tensor], ...]

    @property
    def sin_v(self) -> Float[Tensor, "p s"]:
        return ((1 - self.cos_v) * (1 + self.cos_v)).sqrt()

    def to_local(self, x: Tensor, y: Tensor, z: Tensor) -> tuple[Tensor, ...]:
        return tuple(x * axis[0] + y * axis[1] + z * axis[2] for axis in self.axes)

    def to_world(self, x: Tensor, y: Tensor, z: Tensor) -> tuple[Tensor, ...]:
        tangent, bitangent, normal = self.axes
        return tuple(x * t + y * b + z * n for t, b, n in zip(tangent, bitangent, normal, strict=True))


def _frames(surface: GBuffer, ray: Tensor) -> _Frames:
    """Local frames in which the view lies in the xz plane, for the ray of the footprint that each sample takes."""
    normal, view, cos_v = surface.normal, surface.view, surface.n_dot_v
    tangent = view - cos_v[..., None] * normal
    # Looking straight down any tangent will do: take one that is surely not parallel to the normal.
    axis = torch.nn.functional.one_hot(normal.abs().argmin(-1), 3).to(normal)
    fallback = torch.linalg.cross(normal, axis)
    tangent = torch.where(tangent.norm(dim=-1, keepdim=True) > 1e-9, tangent, fallback)
    tangent = torch.nn.functional.normalize(tangent, dim=-1)
    bitangent = torch.linalg.cross(normal, tangent)
    axes = tuple(tuple(axis[:, ray, i].float().contiguous() for i in range(3)) for axis in (tangent, bitangent, normal))
    return _Frames(cos_v[:, ray].float().clamp(1e-6, 1), axes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class _Points:
    """The Sobol points of the lobe's samples, and the ray of the footprint that each of them takes."""

    u1: Float[Tensor, " s"]
    u2: Float[Tensor, " s"]
    ray: Tensor

    @staticmethod
    def draw(samples: int, rays: int, seed: int, device: torch.device) -> _Points:
        u1, u2, u3 = torch.quasirandom.SobolEngine(3, scramble=True, seed=seed).draw(samples).T.to(device)
        return _Points(u1, u2, (u3 * rays).long().clamp_max(rays - 1))

    def shifted(self, pixels: int, generator: torch.Generator) -> tuple[Float[Tensor, "p s"], Float[Tensor, "p s"]]:
        """The points under another shift for each pixel [Cranley & Patterson 1976], so that errors average out."""
        shift = torch.rand(2, pixels, 1, generator=generator, device=generator.device)
        return (self.u1 + shift[0]) % 1, (self.u2 + shift[1]) % 1


@dataclass(frozen=True)
class _Directions:
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


def _draw_lobe(
    light: LatLong, frame: _Frames, alpha: float, u1: Float[Tensor, "p s"], u2: Float[Tensor, "p s"]
) -> _Directions:
    hx, hy, hz = lobe.sample_visible_normals(frame.cos_v, alpha, u1, u2)
    cos_d = (frame.sin_v * hx + frame.cos_v * hz).clamp(0, 1)
    cos_l = 2 * cos_d * hz - frame.cos_v
    world = frame.to_world(2 * cos_d * hx - frame.sin_v, 2 * cos_d * hy, cos_l)
    found = latlong.lookup(light, *world)
    return _Directions(cos_l, hz, cos_d, found[..., :3], found[..., 3], None)


def _draw_lamps(sampler: LampSampler, light: LatLong, frame: _Frames, generator: torch.Generator) -> _Directions:
    pixels, samples = frame.cos_v.shape
    stratum = torch.arange(samples, device=generator.device)
    # Odd strata after even ones: each half of the samples then covers all of the light.
    stratum = torch.cat([stratum[0::2], stratum[1::2]])
    u, u1, u2 = torch.rand(3, pixels, samples, generator=generator, device=generator.device)
    x, y, z, density = lamps.sample(sampler, (stratum + u) / samples, u1, u2)
    found = latlong.lookup(light, x, y, z)
    lx, ly, lz = frame.to_local(x, y, z)
    hx, hy, hz = lx + frame.sin_v, ly, lz + frame.cos_v
    scale = torch.rsqrt((hx**2 + hy**2 + hz**2).clamp_min(1e-12))
    cos_h = (hz * scale).clamp(1e-6, 1)  # below the horizon nothing is counted; the bound keeps tan θ finite
    cos_d = ((frame.sin_v * hx + frame.cos_v * hz) * scale).clamp(0, 1)
    return _Directions(lz, cos_h, cos_d, found[..., :3], found[..., 3], density / found[..., 3])


def _weighted_light(
    frame: _Frames, alpha: float, distribution: lobe.Distribution, directions: _Directions
) -> Float[Tensor, "p s 3"]:
    """What each direction adds to the pixel's light, times the number of directions.

    With p_b and p_e the densities of lobe and environment, drawn equally often, every direction adds
    f L / (p_b + p_e), whoever drew it; f/p_b is `reflection_weight`, without the reflectance F. The sum stays exact
    with an interpolated p_e as long as both kinds of directions use it and the one drawn from the environment is
    divided by the density really drawn.
    """
    weight = lobe.reflection_weight(frame.cos_v, directions.cos_l, directions.cos_h, alpha, distribution)
    width = weight.new_tensor(alpha)
    lobe_density = (
        lobe.smith_g1(frame.cos_v, width, "ggx")
        * lobe.distribution_of_normals(directions.cos_h, width, "ggx")
        / (4 * frame.cos_v)
    )
    factor = weight * lobe_density / (lobe_density + directions.lamp_density)
    if directions.oversampling is not None:
        factor = factor / directions.oversampling
    return directions.radiance * factor[..., None]


def _moments(light: Float[Tensor, "p s 3"], cos_d: Float[Tensor, "p s"], degree: int) -> Float[Tensor, "2 p b 3"]:
    """Means of T_b(2 cos_d - 1) · light over each half of the samples."""
    samples = cos_d.shape[1]
    basis = chebyshev.polynomials(2 * cos_d - 1, degree).permute(1, 0, 2)
    halves = (slice(0, samples // 2), slice(samples // 2, samples))
    return torch.stack([torch.bmm(basis[:, :, half], light[:, half]) / (samples // 2) for half in halves])
