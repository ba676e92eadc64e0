"""Which pixels are fitted, and the surface that each of them sees."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.fitter.observations.photograph import Photograph
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.view_sampling import strata
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.pixel_footprint import FEW, is_smooth
from fit_material.renderer.rays.self_visibility import hidden_share, sees_itself

ANGLE_BINS = 16
FEWEST = 8  # one in so many of a photograph's pixels is taken, even if it mirrors the object
EDGED = 7  # rays along a pixel's side at least where most pixels have an edge inside: a fiftieth of its area each
MANY = 1 << 20  # pixels of a photograph that are shuffled as a whole
JPEG_BLOCK = 16  # pixels, of whose colours most cameras keep every second in either direction, in blocks of eight
CANDIDATES = 4  # per pixel that is wanted, so that the rare grazing ones are among them
BOUNDS = 8  # one clipped pixel at most for so many that are wanted: it determines less than they do, and costs as much


@dataclass(frozen=True)
class Observations:
    """Pixels chosen for the fit of one material.

    Attributes:
        surface: [p, k] rays inside each pixel.
        radiance: what the photographs show there, float64.
        self_seeing: share of the candidates that were left out because they mirror the object itself.
        edged: whether most pixels have an edge inside, as facets' are.
        available: how many pixels like these there are, by the share that was fit for use of those looked at.
        place: photograph, row and column of each; those of one photograph are next to each other.
        lossy: photographs that are compressed by blocks.
        point: which place of the surface each pixel sees, where they were chosen so that several see the same; None
            where the material is taken for even.
        bounded: pixels that are clipped, of which the radiance is a lower bound, channel by channel; None where none
            is among them.
    """

    surface: GBuffer
    radiance: Float[Tensor, "p 3"]
    self_seeing: float
    edged: bool
    available: int
    place: Int[Tensor, "p 3"]
    lossy: frozenset[int] = frozenset()
    point: Int[Tensor, " p"] | None = None
    bounded: Bool[Tensor, " p"] | None = None

    @property
    def clusters(self) -> Int[Tensor, " p"] | None:
        """Numbers that pixels have in common whose errors go together: of one block of JPEG; None where none do."""
        if not self.lossy:
            return None
        own = torch.stack([torch.zeros(len(self.place)).long(), *self.place.T], 1)
        blocks = torch.cat([torch.ones(len(own), 1).long(), self.place[:, :1], self.place[:, 1:] // JPEG_BLOCK], 1)
        lossy = torch.isin(self.place[:, 0], torch.tensor(sorted(self.lossy)))
        return torch.where(lossy[:, None], blocks, own).unique(dim=0, return_inverse=True)[1]

    def __getitem__(self, index: slice) -> Observations:
        """Some of the pixels; of points, none of which is bounded, all pixels of some."""
        if self.point is None:
            return self._at(index)
        chosen = torch.isin(self.point, self.point.unique()[index])
        taken = {key: getattr(self, key)[chosen] for key in ("surface", "radiance", "place", "point")}
        return replace(self, **taken)

    @property
    def measured(self) -> Observations:
        """Without those that are only bounded."""
        return self if self.bounded is None else replace(self._at(~self.bounded), bounded=None)

    def _at(self, index: slice | Tensor) -> Observations:
        taken = {key: getattr(self, key)[index] for key in ("surface", "radiance", "place")}
        return replace(self, **taken, bounded=None if self.bounded is None else self.bounded[index])

    @property
    def freedom(self) -> float:
        """Fraction of the pixels' differences that the points' own colours do not absorb, in (0, 1]."""
        if self.point is None:
            return 1.0
        return 1 - len(self.point.unique()) / len(self.point)


def choose_pixels(request: PixelRequest, count: int) -> list[Observations | None]:
    """At most `count` pixels of each material, spread evenly over the angles at which the surface is seen.

    Only near grazing angles does reflectance separate n from k, and a photograph has few pixels there; an even spread
    keeps them. Pixels whose footprint leaves the front of the object or the material are never taken; those with an
    edge inside only where most have one, those that mirror the object itself only where a photograph has few others.
    Clipped pixels come on top of them, a few for what they are worth: bounds.

    Args:
        request: from what; its footprint gives way to `EDGED` where most pixels of an object have an edge inside and
            not just few rays are wanted.
        count: pixels wanted of each material over all photographs, of which each contributes the same number as far
            as it has them.

    Returns:
        for each material its pixels; None where no photograph has any.

    Raises:
        InputError: a camera sees nothing of the object where its mask is, or sees it from inside.
    """
    chosen = _chosen(request, count)
    edged = any(part is not None and part.edged for part in chosen)
    refine = edged and FEW <= request.footprint**2 < EDGED**2
    return _chosen(replace(request, footprint=EDGED), count) if refine else chosen


def _chosen(request: PixelRequest, count: int) -> list[Observations | None]:
    """The pixels of each material by rays of one footprint."""
    quota, generator = -(-count // len(request.used)), torch.Generator().manual_seed(request.seed)
    measured: list[list[Observations]] = [[] for _ in range(request.materials)]
    bounds: list[list[Observations]] = [[] for _ in range(request.materials)]
    for index in request.used:
        photograph = request.photographs[index]
        request.progress(index / len(request.photographs))
        candidates = _candidates(request, photograph, index, quota, generator)
        request.require_front(index, candidates.centres)
        found = _observed(request, candidates, quota)
        if not any(found):
            raise request.unseen(index, "a pixel that the object covers wholly; come nearer")
        _append(measured, found)
        if (clipped := photograph.of_bounds) is not None:
            few = max(1, quota // BOUNDS)
            candidates = _candidates(request, clipped, index, few, generator)
            _append(bounds, _observed(request, candidates, few, strict=True))
    return [_bounded(_joined(part, count), _joined(more, count)) for part, more in zip(measured, bounds, strict=True)]


def _append(parts: list[list[Observations]], found: list[Observations | None]) -> None:
    for part, each in zip(parts, found, strict=True):
        part += [each] if each is not None else []


def _joined(parts: list[Observations], count: int) -> Observations | None:
    """The pixels of all photographs."""
    if not parts:
        return None
    return Observations(
        gbuffer.concatenate([part.surface for part in parts])[:count],
        torch.cat([part.radiance for part in parts])[:count],
        sum(part.self_seeing for part in parts) / len(parts),
        any(part.edged for part in parts),
        sum(part.available for part in parts),
        torch.cat([part.place for part in parts])[:count],
        frozenset().union(*(part.lossy for part in parts)),
    )


def _bounded(measured: Observations | None, bounds: Observations | None) -> Observations | None:
    """Both, those of one photograph next to each other; None where nothing is measured."""
    if measured is None or bounds is None:
        return measured
    both = (measured, bounds)
    joined = replace(
        measured,
        surface=gbuffer.concatenate([each.surface for each in both]),
        radiance=torch.cat([each.radiance for each in both]),
        place=torch.cat([each.place for each in both]),
        bounded=torch.cat([torch.full((len(each.place),), each is bounds) for each in both]),
    )
    return joined._at(joined.place[:, 0].argsort(stable=True))


@dataclass(frozen=True)
class _Candidates:
    """Pixels of one photograph.

    Attributes:
        photograph: that they are of.
        number: of the photograph.
        pixels: row and column.
        centres: the ray through the centre of each.
        share: fraction of the photograph's pixels that was examined.
    """

    photograph: Photograph
    number: int
    pixels: Int[Tensor, "p 2"]
    centres: GBuffer
    share: float

    def of(self, material: int) -> _Candidates:
        chosen = self.centres.front & (self.centres.material == material)
        return replace(self, pixels=self.pixels[chosen], centres=self.centres[chosen])


def _candidates(
    request: PixelRequest, photograph: Photograph, number: int, quota: int, generator: torch.Generator
) -> _Candidates:
    inside, width = photograph.mask.flatten().nonzero()[:, 0], photograph.mask.shape[1]
    drawn = inside[_drawn(len(inside), CANDIDATES * quota * request.materials, generator)]
    share = len(drawn) / max(1, len(inside))
    pixels = torch.stack([drawn // width, drawn % width], 1)
    centres = gbuffer.pixel_footprints(request.trace, photograph.camera, pixels[:, 1], pixels[:, 0], 1)[:, 0]
    return _Candidates(photograph, number, pixels, centres, share)


def _drawn(count: int, most: int, generator: torch.Generator) -> Int[Tensor, " c"]:
    """At most so many different indices below `count`, by chance and in any order.

    To order millions takes longer than to read them: of many, one is drawn from each of equal parts.
    """
    if count <= MANY:
        return torch.randperm(count, generator=generator)[:most]
    drawn = strata(count, most, generator)
    return drawn[torch.randperm(len(drawn), generator=generator)]


def _observed(
    request: PixelRequest, candidates: _Candidates, quota: int, strict: bool = False
) -> list[Observations | None]:
    """The pixels of each material in one photograph, None of one that has none there.

    Those that mirror the object are taken of materials that are `kept`, and where a material has few others, unless
    that is `strict`.
    """
    return [_of_material(request, candidates.of(index), index, quota, strict) for index in range(request.materials)]


def _of_material(
    request: PixelRequest, own: _Candidates, material: int, quota: int, strict: bool
) -> Observations | None:
    if not len(own.pixels):
        return None
    kept, footprint = material in request.kept, request.footprint
    mirrors_itself = torch.zeros_like(own.centres.hit) if kept else sees_itself(request.trace, own.centres)
    fewest = 0 if strict else max(1, min(quota, len(own.pixels)) // FEWEST)
    usable = _freest(request.trace, own.centres, mirrors_itself, fewest)
    if not usable.any():
        return None
    pixels, n_dot_v = own.pixels[usable], own.centres.n_dot_v[usable]
    pixels = pixels[_evenly_by_angle(n_dot_v, quota + quota // 8)]  # some will not be whole
    surface = gbuffer.pixel_footprints(request.trace, own.photograph.camera, pixels[:, 1], pixels[:, 0], footprint)
    whole = (surface.front & (surface.material == material)).all(-1)
    smooth = whole & without_edge(surface, footprint)
    edged = bool(2 * smooth.sum() < whole.sum())
    taken = whole if edged else smooth
    row, column = pixels[taken][:quota].T
    radiance = own.photograph.radiance[row, column].double()
    self_seeing = float(mirrors_itself.double().mean())
    available = round(len(n_dot_v) * float(taken.double().mean()) / own.share)
    place = torch.stack([torch.full_like(row, own.number), row, column], 1)
    lossy = frozenset([own.number] if own.photograph.lossy else [])
    found = Observations(surface[taken][:quota], radiance, self_seeing, edged, available, place, lossy)
    return found if len(radiance) else None


def without_edge(surface: GBuffer, footprint: int) -> Bool[Tensor, " p"]:
    """Pixels between whose rays others can be interpolated; not the outermost, where angles end."""
    if footprint == 1:
        return torch.ones_like(surface.hit[:, 0])
    return is_smooth(surface.normal.reshape(-1, footprint, footprint, 3))


def _freest(trace: Tracer, centres: GBuffer, mirrors_itself: Bool[Tensor, " p"], fewest: int) -> Bool[Tensor, " p"]:
    """The pixels that do not mirror the object; where they are fewer, as many of those that mirror the least of it."""
    if (~mirrors_itself).sum() >= fewest:
        return ~mirrors_itself
    least = hidden_share(trace, centres).argsort(stable=True)[:fewest]
    return torch.zeros_like(mirrors_itself).index_fill(0, least, True)


def _evenly_by_angle(n_dot_v: Float[Tensor, " p"], count: int) -> Int[Tensor, " c"]:
    """Indices of at most `count` pixels, taken in turn from bins of equal width in n·v."""
    angle_bin = (n_dot_v * ANGLE_BINS).long().clamp(0, ANGLE_BINS - 1)
    order = torch.argsort(angle_bin, stable=True)
    in_bin = torch.bincount(angle_bin, minlength=ANGLE_BINS)
    first = in_bin.cumsum(0) - in_bin
    turn = torch.arange(len(order)) - first[angle_bin[order]]
    return order[torch.argsort(turn, stable=True)][:count]
