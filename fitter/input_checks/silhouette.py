"""Findings about where the object is: the silhouette that mesh and camera make, against the photograph's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import fmean

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.input_checks.finding import Finding, percent
from fit_material.fitter.input_checks.orientation import TURNS, UPS, about_y, upright
from fit_material.fitter.observations.photograph import Photograph
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer

FEWEST = 16  # pixels of a silhouette's border
SIDE = 96  # pixels of the longer side that are looked at
OVERLAPS = 0.95  # IoU below which something is wrong: a shift by 2 % of a ball's width leaves that
DECISIVE = 3.0  # times less outside of the overlap if the mesh is rotated: no pose error does that
SEARCHED = 0.12  # of the picture's width: how far off edges are looked for
ON_EDGE = 0.03  # of the picture's width: as far from an edge as a silhouette of that IoU may be
ALIKE = 0.01  # of IoU, within which silhouettes of two turns are the same
CLEARER = 0.15  # share of pixels, by which the gradient under a moved silhouette outranks that under the given one


@dataclass(frozen=True)
class Sighting:
    """One photograph and what its camera should see, every `step`-th pixel of both.

    Attributes:
        camera: the photograph's.
        hit: where rays meet the object.
        outline: where the photograph has it; None where neither mask nor alpha defines it.
        light: what it shows.
        step: in pixels.
    """

    camera: Camera
    hit: Bool[Tensor, "m n"]
    outline: Bool[Tensor, "m n"] | None
    light: Float[Tensor, "m n"]
    step: int

    @staticmethod
    def of(photograph: Photograph, trace: Tracer) -> Sighting:
        step = max(1, -(-max(photograph.mask.shape) // SIDE))
        hit = _hits(photograph.camera, trace, step)
        outline = None if photograph.outline is None else photograph.outline[::step, ::step]
        light = photograph.radiance[::step, ::step].mean(-1)
        return Sighting(photograph.camera, hit, outline, light, step)

    def by(self, trace: Tracer) -> Sighting:
        """The same photograph of an object that another tracer has."""
        return replace(self, hit=_hits(self.camera, trace, self.step))

    def inside(self, photograph: Photograph) -> Bool[Tensor, "h w"]:
        """Where the object is in its photograph: by mask and alpha, else by the rays that meet it."""
        if photograph.outline is not None:
            return photograph.outline
        every = self.hit.repeat_interleave(self.step, 0).repeat_interleave(self.step, 1)
        height, width = photograph.mask.shape
        return every[:height, :width]

    @cached_property
    def gradient_rank(self) -> Float[np.ndarray, "m n"]:
        """The share of pixels with a weaker gradient of the logarithm of light."""
        from scipy.stats import rankdata
        from skimage.filters import sobel

        light = self.light.numpy()
        dark = 0.05 * max(float(np.median(np.abs(light))), 1e-20)
        gradient = sobel(np.log(np.maximum(light, 0) + dark))
        return (rankdata(gradient) / gradient.size).reshape(gradient.shape)

    @property
    def overlap(self) -> float | None:
        """Intersection over union of both silhouettes; None without an outline."""
        if self.outline is None:
            return None
        either = (self.hit | self.outline).sum()
        return float((self.hit & self.outline).sum() / either) if either else 0.0


def _hits(camera: Camera, trace: Tracer, step: int) -> Bool[Tensor, "m n"]:
    row, column = torch.meshgrid(
        torch.arange(0, camera.height, step), torch.arange(0, camera.width, step), indexing="ij"
    )
    origins, directions = camera.rays(column.flatten() + 0.5, row.flatten() + 0.5)
    return trace(origins, directions).hit.reshape(row.shape)


def turned(trace: Tracer, turn: Float[Tensor, "3 3"]) -> Tracer:
    """The tracer of the object, rotated about the origin."""

    def traced(origins: Float[Tensor, "p 3"], directions: Float[Tensor, "p 3"]) -> GBuffer:
        surface = trace(origins @ turn, directions @ turn)  # by the inverse, into the object's own axes
        axes = {key: getattr(surface, key) @ turn.T for key in ("position", "normal", "geometric_normal", "view")}
        return replace(surface, **axes)

    return traced


@dataclass(frozen=True)
class MeshTurn:
    """A turn of the mesh that brings its silhouettes to the photographs'.

    Attributes:
        up: its axis that has to become +Y.
        turn: degrees about +Y afterwards.
        by_outline: whether outlines decide, else the picture's edges do.
        before, after: mean IoU without it and with it; of edges `edge_rank`.
    """

    up: str
    turn: int
    by_outline: bool
    before: float
    after: float

    @property
    def matrix(self) -> Float[Tensor, "3 3"]:
        return about_y(self.turn) @ upright(self.up)

    @property
    def explains(self) -> bool:
        """Whether the mesh lies so and not as it is given."""
        if not self.by_outline:
            return self.after > self.before + CLEARER
        return self.after >= OVERLAPS - 0.05 and 1 - self.before > DECISIVE * (1 - self.after)


def mesh_turn(sightings: Sequence[Sighting], trace: Tracer) -> MeshTurn | None:
    """The turn by right angles that explains where the object is seen, where none is as good without."""
    outlined = [each for each in sightings if each.outline is not None]
    looked_at = (outlined or list(sightings))[:6]

    def likeness(found: Sequence[Sighting]) -> float:
        return fmean(each.overlap or 0.0 if outlined else edge_rank(each) for each in found)

    before = likeness(looked_at)
    if before >= (OVERLAPS if outlined else 1 - CLEARER):  # nothing can be that much better
        return None
    best: MeshTurn | None = None
    for up in UPS:
        for turn in TURNS:
            tracer = turned(trace, about_y(turn) @ upright(up))
            after = likeness([each.by(tracer) for each in looked_at])
            if best is None or after > best.after + ALIKE:  # of equal ones the first, which slips lead to
                best = MeshTurn(up, turn, bool(outlined), before, after)
    return best if best is not None and best.explains else None


def silhouette_findings(sightings: Sequence[Sighting], names: Sequence[str]) -> list[Finding]:
    """Photographs whose silhouette lies elsewhere than mesh and camera predict."""
    remedy = "check its camera (pose, field of view), the mesh's scale, and the mask"
    found = []
    for sighting, where in zip(sightings, names, strict=True):
        overlap = sighting.overlap
        if overlap is not None:
            if overlap < OVERLAPS:
                value = f"the mesh's silhouette overlaps the mask by {percent(overlap)} (IoU)"
                found.append(Finding("silhouette", where, value, remedy))
        elif not sighting.hit.any():
            found.append(Finding("silhouette", where, "its camera sees 0 % of the object", remedy))
        else:
            distance = edge_distance(sighting)
            if distance > ON_EDGE:
                value = f"the mesh's silhouette lies {percent(distance)} of the picture's width beside its edges"
                found.append(Finding("silhouette", where, value, remedy))
    return found


def edge_distance(sighting: Sighting) -> float:
    """How far the silhouette has to be moved or scaled to lie on the picture's edges, by its width; 0 if on them.

    An edge is recognised by the rank of its gradient among all pixels', which is the same for every exposure and curve.
    """
    rows, columns = _border(sighting.hit)
    if len(rows) < FEWEST:
        return 0.0
    rank = sighting.gradient_rank
    width = rank.shape[1]
    reach = max(1, round(SEARCHED * width))
    centre = rows.mean(), columns.mean()

    def score(down: float, right: float, scale: float) -> float:
        r = np.rint(centre[0] + scale * (rows - centre[0]) + down).astype(int)
        c = np.rint(centre[1] + scale * (columns - centre[1]) + right).astype(int)
        inside = (r >= 0) & (c >= 0) & (r < rank.shape[0]) & (c < width)
        return float(rank[r[inside], c[inside]].mean()) if inside.mean() > 0.7 else 0.0

    near = max(score(down, right, 1.0) for down in (-1, 0, 1) for right in (-1, 0, 1))
    moves = [(d, r, 1.0) for d in range(-reach, reach + 1) for r in range(-reach, reach + 1)]
    moves += [(0, 0, s) for s in np.arange(0.7, 1.43, 0.03)]
    best = max(moves, key=lambda move: score(*move))
    if score(*best) < near + CLEARER:
        return 0.0
    size = np.hypot(rows - centre[0], columns - centre[1]).mean()
    return float(np.hypot(best[0], best[1]) + abs(best[2] - 1) * size) / width


def edge_rank(sighting: Sighting) -> float:
    """Share of the picture's pixels with a weaker gradient than those next to the silhouette have in the mean."""
    from scipy.ndimage import maximum_filter

    rows, columns = _border(sighting.hit)
    if len(rows) < FEWEST:
        return 0.0
    return float(maximum_filter(sighting.gradient_rank, 3)[rows.astype(int), columns.astype(int)].mean())


def _border(hit: Bool[Tensor, "m n"]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the silhouette's pixels that have a neighbour beside it; not where the picture ends."""
    from skimage.segmentation import find_boundaries

    edge = find_boundaries(hit.numpy(), mode="inner")
    edge[[0, -1]] = edge[:, [0, -1]] = False
    rows, columns = edge.nonzero()
    return rows.astype(float), columns.astype(float)
