"""Integration of light through microfacet lobes by one compiled kernel, some nine times faster than torch.

A thread of the kernel is one half of one pixel's samples. It walks through them once, and keeps in its registers the
sums that the table is made of; nothing is stored per sample.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.compute.threads import one_ahead
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.light_kernel.packed_rays import PackedRays, packed
from fit_material.renderer.light_sampling.environment_sampling import along_z_order
from fit_material.renderer.light_sampling.integrator import (
    Integration,
    Integrator,
    LobeGrid,
    Progress,
    StratifiedPixels,
)
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.renderer.rays.pixel_footprint import Places, filled, rays_of, spread_places

_SAMPLES = 1 << 23  # of all levels in one launch: half a second, after which Ctrl-C and progress are heard
_RAYS = 1 << 18  # in one launch: bounds the memory to some 150 MB beside the table itself
_PIXELS = 256  # in one launch at least: fewer leave cores idle
_CELLS = 64  # rows of the grid by which pixels are put in order
_LEVELS = 6  # levels to one kernel: their 36 sums per level and dozen of functions still fit the first cache


@functools.cache
def fused_available() -> bool:
    """Whether Dr.Jit finds LLVM's library, by which it compiles the kernel."""
    import drjit as dr

    return bool(dr.has_backend(dr.JitBackend.LLVM))


@dataclass(frozen=True)
class LlvmIntegrator(Integrator):
    """One kernel that LLVM compiles; the light is on the CPU, the integrals are float32.

    An occluder has to be compiled for Dr.Jit; without one no kernel casts a ray.
    """

    def integrals(
        self,
        pixels: StratifiedPixels,
        environment: Environment,
        occluder: Occluder | None,
        lobes: LobeGrid,
        integration: Integration,
        progress: Progress,
    ) -> Float[Tensor, "2 a p b 3"]:
        from fit_material.renderer.light_kernel.environment import fused_light
        from fit_material.renderer.light_kernel.kernel import moments
        from fit_material.renderer.light_kernel.occlusion import Blocked

        surface, numbers, strata = pixels.surface, pixels.numbers, pixels.strata
        degree, samples, seed = integration.degree, integration.samples, integration.seed
        light, order = fused_light(environment), _by_mirrored_view(surface)
        rays, places = rays_of(surface, strata), Places.draw(numbers, strata, seed)
        step = max(_PIXELS, min(_SAMPLES // (samples * lobes.count), _RAYS // rays))
        table = torch.empty(2, lobes.count, len(pixels), degree, 3)
        parts = order.split(step)

        def prepared(chosen: Tensor) -> tuple[Float[Tensor, "c r 2"], PackedRays]:
            place = places[chosen]
            return place, packed(filled(surface[chosen], place))

        for done, (chosen, (place, there)) in enumerate(zip(parts, one_ahead(prepared, parts), strict=True), 1):
            blocked = None
            if occluder is not None:
                blocked = Blocked.of(occluder, spread_places(occluder.origins(surface[chosen]), place))
            made = [
                moments(light, there, numbers[chosen], each, lobes.distribution, degree, samples, seed, blocked)
                for each in _batches(lobes.groups)
            ]
            table[:, :, chosen] = torch.cat(made, 1)
            progress(done / len(parts))
        return table


def _by_mirrored_view(surface: GBuffer) -> Tensor:
    """Order in which pixels that see about the same part of the surroundings follow each other, and share a cache."""
    normal, view = surface.normal[:, 0], surface.view[:, 0]
    mirrored = 2 * (normal * view).sum(-1, keepdim=True) * normal - view
    row = mirrored[:, 1].clamp(-1, 1).acos() * (_CELLS / math.pi)
    column = torch.atan2(mirrored[:, 0], -mirrored[:, 2]) * (_CELLS / math.pi) + _CELLS
    return torch.from_numpy(along_z_order(row.long().numpy(), column.long().numpy()))


def _batches(groups: Sequence[Sequence[float]]) -> Iterator[list[Sequence[float]]]:
    """Groups that one kernel takes together, because all of them count the directions drawn from the light."""
    batch: list[Sequence[float]] = []
    for group in groups:
        if batch and sum(map(len, batch)) + len(group) > _LEVELS:
            yield batch
            batch = []
        batch.append(group)
    yield batch
