"""Light tables integrated by one compiled kernel: what `light_table` sums in torch, some nine times sooner.

A thread of the kernel is one half of one pixel's samples. It walks through them once, and keeps in its registers the
sums that the table is made of; nothing is stored per sample.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.compute.threads import one_ahead
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.light_kernel.packed_rays import PackedRays, packed
from fit_material.renderer.light_sampling.environment_sampling import along_z_order
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.renderer.rays.pixel_footprint import Places, filled, rays_of, spread_places
from fit_material.shaders.optics import microfacets

Progress = Callable[[float], None]

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


def integrate_fused(
    surface: GBuffer,
    numbers: Int[Tensor, " p"],
    environment: Environment,
    groups: Sequence[Sequence[float]],
    *,
    strata: int,
    distribution: microfacets.Distribution,
    degree: int,
    samples: int,
    seed: int,
    progress: Progress = lambda share: None,
    occluder: Occluder | None = None,
) -> Float[Tensor, "2 a p b 3"]:
    """Light through a GGX or Beckmann lobe, at roughnesses in groups that share directions.

    Args:
        surface: [p, k] rays inside each of p pixels, all on the front of the object.
        numbers: of the pixels; their random numbers follow from them and the seed.
        environment: the light, on the CPU.
        groups: roughnesses, ascending; one group's directions are drawn for their middle.
        strata: along each side of the pixels, see `footprint.strata_of`.
        distribution: "ggx" or "beckmann".
        degree: number of functions in the reflectance basis.
        samples: directions per pixel and level, a multiple of 4.
        seed: of the shifts; the same seed gives the same table.
        progress: told the share that is done, in (0, 1].
        occluder: what may stand before the light, one that Dr.Jit can ask; without it no kernel casts a ray.

    Returns:
        two halves of the samples, roughness level, pixel, function of the basis, channel; float32, on the CPU.
    """
    from fit_material.renderer.light_kernel.environment import fused_light
    from fit_material.renderer.light_kernel.kernel import moments
    from fit_material.renderer.light_kernel.occlusion import Blocked

    light, order, levels = fused_light(environment), _by_mirrored_view(surface), sum(map(len, groups))
    pixels, rays, places = len(surface.hit), rays_of(surface, strata), Places.draw(numbers, strata, seed)
    step = max(_PIXELS, min(_SAMPLES // (samples * levels), _RAYS // rays))
    table = torch.empty(2, levels, pixels, degree, 3)
    parts = order.split(step)

    def prepared(chosen: Tensor) -> tuple[Float[Tensor, "c r 2"], PackedRays]:
        place = places[chosen]
        return place, packed(filled(surface[chosen], place))

    for done, (chosen, (place, there)) in enumerate(zip(parts, one_ahead(prepared, parts), strict=True), 1):
        blocked = None
        if occluder is not None:
            blocked = Blocked.of(occluder, spread_places(occluder.origins(surface[chosen]), place))
        made = [
            moments(light, there, numbers[chosen], each, distribution, degree, samples, seed, blocked)
            for each in _batches(groups)
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
