"""Rays all over each pixel, between the few that were traced."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.renderer.compute import chebyshev
from fit_material.renderer.rays.gbuffer import GBuffer, equal_weight_nodes

FEW = 9  # traced rays, from which no others can be interpolated
STRATA = (6, 12, 20)  # along each side of a pixel, for each half of its rays: from flat pixels to bent ones
ACROSS = 3.5  # of a pixel's normals from edge to edge, in root mean squares of their tilt: √12 where they turn evenly
IN_LOBE = 2  # strata to the width of a lobe: a reflection in less of a pixel must not slip through between rays
SMOOTH = 0.02  # share of the highest polynomial in what was traced, beyond which there is an edge between
BENT = 0.2  # radian between two traced rays of a pixel, beyond which the same holds
LEVEL = 1e-6  # radian by which normals differ that are parallel


@dataclass(frozen=True)
class Rays:
    """The surface as rays see it: unit normals and unit directions to the viewer, world space, float64."""

    normal: Float[Tensor, "p r 3"]
    view: Float[Tensor, "p r 3"]

    @property
    def n_dot_v(self) -> Float[Tensor, "p r"]:
        return (self.normal * self.view).sum(-1)

    @property
    def mean(self) -> Rays:
        """One ray for all of each pixel's, [p, 1]."""
        found = (part.mean(1, keepdim=True) for part in (self.normal, self.view))
        return Rays(*(torch.nn.functional.normalize(part, dim=-1) for part in found))

    @property
    def tilt(self) -> Float[Tensor, " p"]:
        """Mean squared angle of each pixel's normals about their mean, by the mean of 2 (1 - cos)."""
        return 2 * (1 - self.normal.mean(1).norm(dim=-1)).clamp_min(0)

    def to(self, device: torch.device) -> Rays:
        return Rays(self.normal.to(device), self.view.to(device))


def middle(surface: GBuffer) -> GBuffer:
    """One ray for each pixel of [p, k] in place of its k, [p, 1]: mean normal and view, where the nearest ray meets.

    The mean of places would lie below a curved surface.
    """
    mean = Rays(surface.normal, surface.view).mean
    nearest = (surface.view * mean.view).sum(-1).argmax(1)
    return replace(surface[torch.arange(len(nearest)), nearest][:, None], normal=mean.normal, view=mean.view)


def strata_of(surface: GBuffer, alpha: float, samples: int) -> Int[Tensor, " p"]:
    """How many strata along its side each pixel needs, of `STRATA`.

    Near the silhouette the normals of one pixel turn by several widths of a narrow lobe. More rays than directions
    would add nothing; nor would more between traced rays that an edge divides.

    Args:
        surface: [p, k] rays inside each pixel.
        alpha: the narrowest lobe's width.
        samples: directions per pixel, for both halves, a half of which is drawn for rays from the lobe.
    """
    few = torch.full((len(surface.hit),), STRATA[0])
    if surface.hit.shape[1] < FEW:
        return few
    side = math.isqrt(surface.hit.shape[1])
    needed = Rays(surface.normal, surface.view).tilt.sqrt() * (ACROSS * IN_LOBE / alpha)
    needed[~is_smooth(surface.normal.reshape(-1, side, side, 3))] = 0
    for finer, coarser in zip(STRATA[1:], STRATA, strict=False):
        if finer**2 <= samples // 4:
            few[needed > coarser] = finer
    return few


def rays_of(surface: GBuffer, strata: int) -> int:
    """How many rays `filled` has for each pixel."""
    return surface.hit.shape[1] if surface.hit.shape[1] < FEW else 2 * strata**2


@dataclass(frozen=True)
class Places:
    """Where rays run through pixels: in each, two jittered grids, moved within their strata.

    Attributes:
        strata: along each side of a pixel.
        jitter: of both grids' rays within their strata, the same in every pixel.
        shift: of both grids, each pixel's own [Cranley & Patterson 1976].
    """

    strata: int
    jitter: Float[Tensor, "2 c 2"]
    shift: Float[Tensor, "p 2 2"]

    @staticmethod
    def draw(numbers: Int[Tensor, " p"], strata: int, seed: int) -> Places:
        """Places that follow from the pixels' numbers and the seed alone."""
        generator = torch.Generator().manual_seed(seed)
        jitter = torch.rand(2, strata**2, 2, generator=generator)
        shift = torch.rand(1 + int(numbers.max()), 2, 2, generator=generator)[numbers]
        return Places(strata, jitter, shift)

    def __getitem__(self, chosen: Tensor | slice) -> Float[Tensor, "p r 2"]:
        """Row and column of each ray within the chosen pixels, in [0, 1]."""
        along = torch.arange(self.strata)
        cell = torch.stack(torch.meshgrid(along, along, indexing="ij"), -1).reshape(-1, 2)
        within = (self.jitter + self.shift[chosen][:, :, None]) % 1
        return ((cell + within) / self.strata).flatten(1, 2)


def spread_places(positions: Float[Tensor, "p k 3"], place: Float[Tensor, "p r 2"]) -> Float[Tensor, "p r 3"]:
    """Where the rays of `filled` meet the surface: where those traced next to them do, float64."""
    pixels, count = positions.shape[:2]
    if count < FEW:
        return positions
    side = math.isqrt(count)
    nodes = torch.tensor(equal_weight_nodes(side), dtype=torch.float64)
    row, column = _next_to(nodes, place)
    return positions.reshape(pixels, side, side, 3)[torch.arange(pixels)[:, None], row, column]


def filled(surface: GBuffer, place: Float[Tensor, "p r 2"]) -> Rays:
    """Rays spread all over each pixel, the first half of them and the second each evenly by itself.

    A lamp that a narrow lobe mirrors near the silhouette sweeps over all of a pixel: a few fixed rays may miss it, in
    every pixel alike. Where the surface is smooth, normals and views between the traced rays follow from these by
    the polynomial through them; where an edge crosses the pixel, rays are those traced next to them.

    Args:
        surface: [p, side²] of `gbuffer.pixel_footprints`.
        place: of each ray; see `Places`.

    Returns:
        [p, r] rays; those traced where they are fewer than `FEW` per pixel.
    """
    pixels, count = surface.hit.shape
    side = math.isqrt(count)
    if count < FEW:
        return Rays(surface.normal, surface.view)
    nodes = torch.tensor(equal_weight_nodes(side), dtype=torch.float64)
    traced = torch.cat([surface.normal, surface.view], -1).reshape(pixels, side, side, 6)
    found = _interpolated(nodes, traced, place)
    rough = ~is_smooth(traced[..., :3])
    found[rough] = _nearest(nodes, traced[rough], place[rough])
    normal, view = (torch.nn.functional.normalize(part.double(), dim=-1) for part in found.split(3, -1))
    return Rays(normal, view)


def _interpolated(
    nodes: Float[Tensor, " s"], traced: Float[Tensor, "p s s c"], place: Float[Tensor, "p r 2"]
) -> Float[Tensor, "p r c"]:
    """The polynomial through what was traced, at the places; float32, whose 1e-7 radian no lobe resolves."""
    side = len(nodes)
    analysis = chebyshev.analysis(2 * nodes - 1)
    coefficients = torch.einsum("is,jt,pstc->pijc", analysis, analysis, traced).float()
    rows, columns = chebyshev.polynomials(2 * place.float() - 1, side).permute(3, 1, 2, 0)  # each [p, r, s]
    along_rows = torch.bmm(rows, coefficients.flatten(2)).unflatten(2, (side, -1))
    return (columns[..., None] * along_rows).sum(2)


def _nearest(
    nodes: Float[Tensor, " s"], traced: Float[Tensor, "p s s c"], place: Float[Tensor, "p r 2"]
) -> Float[Tensor, "p r c"]:
    """What was traced next to each place; float32."""
    row, column = _next_to(nodes, place)
    return traced[torch.arange(len(traced))[:, None], row, column].float()


def _next_to(nodes: Float[Tensor, " s"], place: Float[Tensor, "p r 2"]) -> tuple[Tensor, ...]:
    """Row and column of the traced ray next to each place, [p, r]."""
    return (place.double()[..., None] - nodes).abs().argmin(-1).unbind(-1)


def is_smooth(normal: Float[Tensor, "p s s 3"]) -> Bool[Tensor, " p"]:
    """Whether normals between the nodes of each pixel follow from those at the nodes.

    So it is where the highest polynomial through them has a small share in their change: its Chebyshev amplitude over
    the difference between the outermost, along rows and columns. Of two nodes a side it is taken for so where they
    differ little.
    """
    across = (normal[:, :, -1] - normal[:, :, 0]).norm(dim=-1).amax(1)
    down = (normal[:, -1] - normal[:, 0]).norm(dim=-1).amax(1)
    if normal.shape[1] < 3:
        return torch.maximum(across, down) < BENT
    rough = torch.maximum(
        _highest(normal) / across.clamp_min(LEVEL), _highest(normal.transpose(1, 2)) / down.clamp_min(LEVEL)
    )
    return rough < SMOOTH


def _highest(normal: Float[Tensor, "p l s 3"]) -> Float[Tensor, " p"]:
    """Amplitude of the highest Chebyshev polynomial on [0, 1] through nodes along the third axis."""
    side = normal.shape[2]
    nodes = torch.tensor(equal_weight_nodes(side), dtype=normal.dtype)
    between = (nodes[:, None] - nodes + torch.eye(side, dtype=normal.dtype)).prod(1)
    highest = 2.0 ** (3 - 2 * side) / between  # of the divided difference
    return torch.einsum("s,plsc->plc", highest, normal).norm(dim=-1).amax(1)
