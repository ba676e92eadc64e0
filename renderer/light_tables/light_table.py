"""Light tables: the light that each pixel receives through its lobe, integrated once, for every roughness and metal.

    radiance(pixel) = Σ_a Σ_b  w_a(roughness) · f_b(n, k) · table[a, pixel, b]

The reflectance of a facet, F(cos_d), is expanded in the few functions of `reflectance_basis`; the table holds the
light weighted by each of them at a few roughnesses. What depends on the material is then only the f_b, found from
F at a few angles, and the interpolation weights w_a: a fit may evaluate thousands of materials at no cost.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.compute import chebyshev
from fit_material.renderer.compute.threads import map_in_threads
from fit_material.renderer.environment import cubemap, latlong
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.environment.latlong import LatLong
from fit_material.renderer.light_kernel.llvm_integrator import LlvmIntegrator, fused_available
from fit_material.renderer.light_sampling.integrator import (
    Integration,
    Integrator,
    LobeGrid,
    Progress,
    StratifiedPixels,
)
from fit_material.renderer.light_tables.torch_integrator import TorchIntegrator
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.renderer.rays.pixel_footprint import strata_of
from fit_material.shaders.materials.widths import Blur, Microfacet, Width
from fit_material.shaders.optics import blur

ROUNDED = 2.0  # units in the last place between the sums of two processors
_CHUNK = 1 << 16  # samples at a time; their tensors then stay in the cache


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
    scale: chebyshev.Scale
    lobe: type[Width] = Microfacet

    @property
    def roughnesses(self) -> list[float]:
        """Of the levels."""
        return chebyshev.levels(self.low, self.high, self.light.shape[1], self.scale)

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
        low, high = (chebyshev.on_scale(roughness.new_tensor(end), self.scale) for end in (self.low, self.high))
        position = (chebyshev.on_scale(roughness.clamp(self.low, self.high), self.scale) - low) / (high - low)
        return chebyshev.weights(2 * position - 1, self.light.shape[1])


def radiance(
    light: Float[Tensor, "a p b 3"], level_weights: Float[Tensor, " a"], coefficients: Float[Tensor, "b c"]
) -> Float[Tensor, "p 3"]:
    """The radiance of each pixel, from a table's mean, roughness weights w_a and Fresnel coefficients f_b."""
    at_roughness = torch.tensordot(level_weights, light, dims=1)
    return (at_roughness * coefficients).sum(1)


def microfacet_table(
    surface: GBuffer,
    environment: Environment,
    lobes: LobeGrid,
    integration: Integration,
    *,
    occluder: Occluder | None = None,
    integrator: Integrator | None = None,
    progress: Progress = lambda share: None,
) -> LightTable:
    """Light through GGX or Beckmann lobes with Smith shadowing, from above the horizon.

    Half of the directions are drawn from the lobe (visible normals at Sobol points, [Heitz 2018]), half from the
    environment, by the blocks of light that the lobe shows bright (`product_sampling`); the balance heuristic [Veach
    1997, eq. 9.8] joins them. The samples walk over the pixel as they walk through the lobe. No lookup is filtered: the
    mean of the table is the exact light. Its halves are independent.

    Args:
        surface: [p, k] rays inside each of p pixels, all on the front of the object.
        environment: the light; the integration runs on its device and in its dtype.
        lobes: the levels of the table.
        integration: samples, and the degree of the basis.
        occluder: blocks light; None where nothing does.
        integrator: by default the faster one that serves here.
        progress: called with the fraction done, in (0, 1].

    Returns:
        the table, on the CPU.
    """
    integrator = integrator or integrator_for(environment, occluder)
    shape = 2, lobes.count, len(surface.hit), integration.degree, 3
    light, done = torch.empty(shape, dtype=environment.radiance.dtype), 0
    needed = strata_of(surface, lobes.low, integration.samples)
    for strata in needed.unique().tolist():
        chosen = (needed == strata).nonzero()[:, 0]
        pixels = StratifiedPixels(surface[chosen], chosen, strata)
        part = _part_of(progress, done / len(needed), len(chosen) / len(needed))
        light[:, :, chosen] = integrator.integrals(pixels, environment, occluder, lobes, integration, part)
        done += len(chosen)
    return LightTable(light, lobes.low, lobes.high, "log")


def integrator_for(environment: Environment, occluder: Occluder | None) -> Integrator:
    """The compiled kernel where it serves: on the CPU, in float32, with LLVM, and an occluder that is compiled."""
    radiance = environment.radiance
    serves = radiance.device.type == "cpu" and radiance.dtype == torch.float32 and fused_available()
    return LlvmIntegrator() if serves and (occluder is None or occluder.compiled is not None) else TorchIntegrator()


def _part_of(progress: Progress, begun: float, share: float) -> Progress:
    """Progress of a share of the work, after what was begun."""
    return lambda part: progress(begun + share * part)


def tap_table(surface: GBuffer, environment: Cubemap, rhos: tuple[float, float, int]) -> LightTable:
    """Light through the thesis's 49 taps around the mirrored view [MODEL.md 3.1]; its only degree is 0.

    Args:
        surface: [p] rays.
        environment: the cubemap that the viewer would read.
        rhos: lowest and highest blur radius, and the number of levels between them.

    Returns:
        the table; its two halves are equal, for the taps are the model and no estimate.
    """
    low, high, _ = rhos
    reflected = reflect(surface).to(environment.faces)
    radiance = functools.partial(cubemap.lookup, environment)
    table = torch.stack(
        [blur.blur(radiance, reflected, reflected.new_tensor(rho)) for rho in chebyshev.levels(*rhos, "linear")]
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
    low, high, _ = rhos
    light, reflected = latlong.of(environment), reflect(surface).to(environment.radiance)
    levels = chebyshev.levels(*rhos, "linear")
    offsets = blur.gaussian_offsets(samples // 2, seed, reflected)
    step = max(1, _CHUNK // samples)

    def integrate(start: int) -> Float[Tensor, "2 a c 3"]:
        part = reflected[start : start + step]
        return torch.stack([torch.stack([_mean_light(light, part, half, rho) for rho in levels]) for half in offsets])

    table = torch.cat(list(map_in_threads(integrate, range(0, len(reflected), step))), 2)
    return LightTable(table[:, :, :, None], low, high, "linear", Blur)


def _mean_light(light: LatLong, r: Float[Tensor, "p 3"], offsets: Float[Tensor, "s 2"], rho: float) -> Tensor:
    """Mean light of the Gaussian lobe of ρ around r, [p, 3]."""
    towards = blur.gaussian_directions(r, offsets, rho)
    return latlong.lookup(light, *towards.unbind(-1)).mean(1)


def reflect(surface: GBuffer) -> Float[Tensor, "*p 3"]:
    """r = 2(n·v)n - v, the mirrored view."""
    return 2 * surface.n_dot_v[..., None] * surface.normal - surface.view
