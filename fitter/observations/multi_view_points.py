"""Points of the surface that several photographs see: what a fit is based on where the colour varies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.fitter.observations.photograph import Photograph
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import Observations, without_edge
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.self_visibility import sees_itself

LEAST_COSINE = 0.15  # n·v, below which a pixel covers too much of the surface to be about one point
SAME_PLACE = 1e-3  # of the object's extent: what a ray meets farther from a point hides it
SEEN_BY = 2.5  # photographs that see a point, less than which is rare where they overlap
FEWEST = 40  # points; fewer do not distinguish a reflection from a colour


@dataclass(frozen=True)
class _Sighting:
    """What one photograph shows of points.

    Attributes:
        point: their numbers.
        place: photograph, row and column.
        surface: [s, k] rays inside a pixel about each.
        radiance: of the photograph there.
        mirrors_itself: whether the object mirrors itself there.
    """

    point: Int[Tensor, " s"]
    place: Int[Tensor, "s 3"]
    surface: GBuffer
    radiance: Float[Tensor, "s 3"]
    mirrors_itself: Bool[Tensor, " s"]


def choose_points(request: PixelRequest, count: int) -> list[Observations | None]:
    """At most `count` pixels of each material, which see points of its surface that two photographs or more see.

    Points are drawn from all photographs' pixels and looked for in every other one, where radiance is interpolated
    between pixels: so that all see the same point, and not just one nearby of another colour.

    Args:
        request: from what.
        count: pixels wanted of each material, over all photographs.

    Returns:
        for each material its pixels, with the number of each one's point; None where fewer than `FEWEST` are seen
        twice.

    Raises:
        InputError: a camera sees nothing of the object where its mask is, or sees it from inside.
    """
    generator = torch.Generator().manual_seed(request.seed)
    each = -(-int(2 * count * request.materials / SEEN_BY) // len(request.used))
    points = gbuffer.concatenate([_drawn(request, index, each, generator) for index in request.used])
    sightings, pixels = [], 0
    for done, index in enumerate(request.used):
        request.progress(done / len(request.used))
        photograph = request.photographs[index]
        sightings.append(_sighting(request, photograph, index, points))
        pixels += int(photograph.mask.sum())
    each_for = pixels / max(1, len(points.hit))
    return [
        _observed(sightings, index, count, index in request.kept, each_for, generator)
        for index in range(request.materials)
    ]


def _drawn(request: PixelRequest, index: int, count: int, generator: torch.Generator) -> GBuffer:
    """The surface at the centres of some of a photograph's pixels."""
    photograph = request.photographs[index]
    row, column = photograph.mask.nonzero().T
    chosen = torch.randperm(len(row), generator=generator)[:count]
    centres = gbuffer.pixel_footprints(request.trace, photograph.camera, column[chosen], row[chosen], 1)[:, 0]
    request.require_front(index, centres)
    return centres[centres.front & (centres.n_dot_v > LEAST_COSINE)]


def _sighting(request: PixelRequest, photograph: Photograph, number: int, points: GBuffer) -> _Sighting:
    """The points that a photograph sees whole."""
    camera, trace, footprint = photograph.camera, request.trace, request.footprint
    x, y, before = camera.film(points.position)
    inside = (before > 0) & (x >= 0.5) & (x <= camera.width - 0.5) & (y >= 0.5) & (y <= camera.height - 0.5)
    point = inside.nonzero()[:, 0]
    centres = gbuffer.pixel_footprints(trace, camera, x[point] - 0.5, y[point] - 0.5, 1)[:, 0]
    away = (centres.position - points.position[point]).norm(dim=-1)
    extent = (points.position.amax(0) - points.position.amin(0)).norm()
    usable = centres.front & (centres.n_dot_v > LEAST_COSINE) & (away < SAME_PLACE * extent)
    point, centres = point[usable], centres[usable]
    x, y = x[point], y[point]
    across, down = (_interpolated_width(each) for each in (x, y))
    surface = gbuffer.film_footprints(trace, camera, x, y, across, down, footprint)
    radiance, known = _interpolated(photograph, x, y)
    whole = (surface.front & (surface.material == centres.material[:, None])).all(-1)
    smooth = whole & without_edge(surface, footprint)
    usable = known & (whole if 2 * smooth.sum() < whole.sum() else smooth)  # facets leave few without an edge
    place = torch.stack([torch.full_like(point, number), y.long(), x.long()], 1)
    mirrors = sees_itself(trace, centres[usable])
    return _Sighting(point[usable], place[usable], surface[usable], radiance[usable], mirrors)


def _interpolated_width(position: Float[Tensor, " s"]) -> Float[Tensor, " s"]:
    """Side of the square of film of which `_interpolated` is about the mean, in pixels.

    Between pixels, a share f from one's centre to the next one's, it mixes both with a variance of 1/12 + f (1 - f)
    about the place; a square of side w has w²/12. Taken for one pixel it would be a wider lobe.
    """
    share = (position - 0.5) - (position - 0.5).floor()
    return (1 + 12 * share * (1 - share)).sqrt()


def _interpolated(
    photograph: Photograph, x: Float[Tensor, " s"], y: Float[Tensor, " s"]
) -> tuple[Float[Tensor, "s 3"], Bool[Tensor, " s"]]:
    """Radiance between pixels' centres, bilinearly, and whether all pixels that it is taken from can be used."""
    height, width = photograph.mask.shape
    column, row = (x - 0.5).floor().long().clamp(0, width - 2), (y - 0.5).floor().long().clamp(0, height - 2)
    right, down = x - 0.5 - column, y - 0.5 - row
    found, known = torch.zeros(len(x), 3, dtype=torch.float64), torch.ones(len(x), dtype=torch.bool)
    for i, share_down in enumerate((1 - down, down)):
        for j, share_right in enumerate((1 - right, right)):
            share = share_down * share_right
            found += share[:, None] * photograph.radiance[row + i, column + j].double()
            known &= photograph.mask[row + i, column + j] | (share < 1e-6)
    return found, known


def _observed(
    sightings: Sequence[_Sighting], material: int, count: int, kept: bool, each_for: float, generator: torch.Generator
) -> Observations | None:
    """The pixels of some points of a material, all that there are of each; a point stands for `each_for` pixels."""
    point, place = (torch.cat([getattr(each, key) for each in sightings]) for key in ("point", "place"))
    surface = gbuffer.concatenate([each.surface for each in sightings])
    radiance = torch.cat([each.radiance for each in sightings])
    mirrors = torch.cat([each.mirrors_itself for each in sightings])
    own = surface.material[:, 0] == material
    self_seeing = float(mirrors[own].double().mean()) if own.any() else 0.0
    usable = own if kept else own & ~mirrors
    point, place, surface, radiance = point[usable], place[usable], surface[usable], radiance[usable]
    if not len(point):
        return None
    times = torch.bincount(point)
    again = (times >= 2).nonzero()[:, 0]
    available = round(each_for * len(again))
    again = again[torch.randperm(len(again), generator=generator)]
    again = again[times[again].cumsum(0) <= count]
    if len(again) < FEWEST:
        return None
    chosen = torch.isin(point, again)
    order = chosen.nonzero()[:, 0][point[chosen].argsort(stable=True)]  # a point's pixels together
    taken = (surface[order], radiance[order], self_seeing, False, available, place[order])
    return Observations(*taken, point=point[order])
