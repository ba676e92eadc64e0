"""Which pixels a picture would give to a fit, known from a sample of them; for pictures taken and not taken."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.self_visibility import sees_itself

ANGLE_BINS = 16  # of equal width in n·v, as `selection.choose_pixels` spreads its pixels
LOOKED_AT = 4096  # pixels of a picture whose centres are traced, to know how many it has of each angle
MIRRORED = 2  # times as many pixels are tested for mirroring the object: of a hollow one, most do

Pixels = Int[Tensor, "p 2"]
"""Row and column."""


@dataclass(frozen=True)
class View:
    """A sample of the pixels by which one picture shows one material, spread evenly over the angles.

    Attributes:
        surface: [p, k] rays inside each pixel.
        pixels: where they are.
        angle_bin: which of `ANGLE_BINS`, [p].
        available: how many pixels a fit could take of each bin, in the whole picture.
    """

    surface: GBuffer
    pixels: Pixels
    angle_bin: Int[Tensor, " p"]
    available: Float[Tensor, " bins"]


def sampled_views(
    trace: Tracer,
    camera: Camera,
    allowed: Bool[Tensor, "h w"] | None,
    *,
    materials: int,
    count: int,
    footprint: int,
    generator: torch.Generator,
) -> list[View]:
    """What a picture shows of each material.

    As in a fit, pixels whose footprint leaves the object's front or the material do not count, and neither do those
    that mirror the object itself; of a photograph that was taken they do where it has no others.

    Args:
        trace: of the object.
        camera: from where.
        allowed: pixels of a photograph that was taken; None for one that was not, all of whose pixels are.
        materials: how many the object has.
        count: pixels wanted of each.
        footprint: rays along each side of a pixel.
        generator: of the choice.
    """
    total = camera.width * camera.height if allowed is None else int(allowed.sum())
    chosen = strata(total, LOOKED_AT, generator)
    pixels = _pixel(chosen, camera.width) if allowed is None else allowed.nonzero()[chosen]
    centres = gbuffer.pixel_footprints(trace, camera, pixels[:, 1], pixels[:, 0], 1)[:, 0]
    picture = _Picture(trace, camera, allowed is None, footprint, generator)
    each = total / max(1, len(chosen))  # pixels of the picture that one of these stands for
    found = []
    for material in range(materials):
        own = (centres.front & (centres.material == material)).nonzero()[:, 0]
        own = own[torch.randperm(len(own), generator=generator)]
        found.append(picture.of_material(pixels[own], centres[own], each, count, material))
    return found


@dataclass(frozen=True)
class _Picture:
    """Where from, whether it was only imagined, and how its pixels are traced."""

    trace: Tracer
    camera: Camera
    imagined: bool
    footprint: int
    generator: torch.Generator

    def of_material(self, pixels: Pixels, centres: GBuffer, each: float, count: int, material: int) -> View:
        """Some of a material's pixels that a fit could use; and of each angle as large a share of the picture's."""
        available = each * histogram(_bin_of(centres.n_dot_v))
        tried = _first_of_each_bin(centres.n_dot_v, MIRRORED * count)
        pixels, centres = pixels[tried], centres[tried]
        free = self._free(centres)
        available = available * _share(free, centres)
        pixels, centres = pixels[free], centres[free]
        tried = _first_of_each_bin(centres.n_dot_v, count)
        pixels, centres = pixels[tried], centres[tried]
        surface = gbuffer.pixel_footprints(self.trace, self.camera, pixels[:, 1], pixels[:, 0], self.footprint)
        whole = (surface.front & (surface.material == material)).all(-1)
        return View(surface[whole], pixels[whole], _bin_of(centres[whole].n_dot_v), available * _share(whole, centres))

    def _free(self, centres: GBuffer) -> Bool[Tensor, " p"]:
        """Which do not mirror the object itself; all, in a photograph that was taken and has no others."""
        if not len(centres.hit):
            return torch.zeros(0, dtype=torch.bool)
        mirroring = sees_itself(self.trace, centres)
        return mirroring if mirroring.all() and not self.imagined else ~mirroring


def _share(kept: Bool[Tensor, " p"], centres: GBuffer) -> Float[Tensor, " bins"]:
    """The share that is kept of each angle; 0 where there is none."""
    angle_bin = _bin_of(centres.n_dot_v)
    return histogram(angle_bin[kept]) / histogram(angle_bin).clamp_min(1)


def strata(total: int, most: int, generator: torch.Generator) -> Int[Tensor, " c"]:
    """Different indices below `total`, one at random from each of at most `most` equal parts."""
    if total <= most:
        return torch.arange(total)
    start = torch.arange(most, dtype=torch.float64)
    return ((start + torch.rand(most, dtype=torch.float64, generator=generator)) * (total / most)).long()


def _pixel(index: Int[Tensor, " p"], width: int) -> Pixels:
    return torch.stack([index // width, index % width], 1)


def _bin_of(n_dot_v: Float[Tensor, " p"]) -> Int[Tensor, " p"]:
    return (n_dot_v * ANGLE_BINS).long().clamp(0, ANGLE_BINS - 1)


def histogram(angle_bin: Int[Tensor, " p"]) -> Float[Tensor, " bins"]:
    return torch.bincount(angle_bin, minlength=ANGLE_BINS).double()


def _first_of_each_bin(n_dot_v: Float[Tensor, " p"], count: int) -> Int[Tensor, " c"]:
    """Indices of about `count` pixels, spread over the bins as far as these have any."""
    angle_bin = _bin_of(n_dot_v)
    taken = taken_evenly(histogram(angle_bin), count).ceil()
    order = torch.argsort(angle_bin, stable=True)
    in_bin = histogram(angle_bin).long()
    turn = torch.arange(len(order)) - (in_bin.cumsum(0) - in_bin)[angle_bin[order]]
    return order[turn < taken[angle_bin[order]]]


def taken_evenly(available: Float[Tensor, " bins"], count: float) -> Float[Tensor, " bins"]:
    """How many of each bin make up `count` together where all give alike, but none more than it has.

    min(available, level), with the level at which the sum is `count`.
    """
    ascending = available.sort().values
    filled = torch.cat([ascending.new_zeros(1), ascending.cumsum(0)[:-1]])
    level = (count - filled) / torch.arange(len(ascending), 0, -1)  # if all smaller bins were emptied, and no other
    possible = level[level <= ascending]
    return available.clamp_max(float(possible.max())) if len(possible) else available
