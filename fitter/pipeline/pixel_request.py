"""The pixels that a fit asks for: which, and how many of each material."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fit_material.fitter.observations.multi_view_points import choose_spots
from fit_material.fitter.observations.photograph import Photograph
from fit_material.fitter.observations.pixel_selection import Observations, choose_pixels
from fit_material.renderer.rays.gbuffer import Tracer

Chosen = list[Observations | None]
"""The pixels of each material; None where no photograph has any."""


@dataclass(frozen=True)
class PixelRequest:
    """Which pixels of a scene are wanted, whatever their number.

    Attributes:
        photographs: to choose from.
        trace: of the object.
        scene_file: for the sentences of errors.
        materials: how many the object has.
        footprint: rays along each side of a pixel.
        seed: of the choice among many.
        left_out: photographs that are not looked at.
        kept: materials of which pixels are taken though they mirror the object.
        by_points: whether to prefer points of the surface that several photographs see, for colours that vary.
        progress: told the share of the photographs that is done.
    """

    photographs: Sequence[Photograph]
    trace: Tracer
    scene_file: Path
    materials: int
    footprint: int
    seed: int
    left_out: Collection[int]
    kept: Collection[int]
    by_points: bool
    progress: Callable[[float], None]

    def chosen(self, count: int) -> Chosen:
        """At most so many pixels of each material; by points where enough of them are seen by two photographs."""
        if not self.by_points:
            return self._chosen_by(choose_pixels, count)
        points = self._chosen_by(choose_spots, count)
        if None not in points:
            return points
        return [found or pixels for found, pixels in zip(points, self._chosen_by(choose_pixels, count), strict=True)]

    def _chosen_by(self, choose: Callable[..., Chosen], count: int) -> Chosen:
        return choose(
            self.photographs,
            self.trace,
            self.scene_file,
            count=count,
            footprint=self.footprint,
            seed=self.seed,
            materials=self.materials,
            left_out=self.left_out,
            kept=self.kept,
            progress=self.progress,
        )


@dataclass(frozen=True)
class PixelsByCount:
    """The pixels of one request, chosen once for each number of them: all materials are chosen together."""

    request: PixelRequest
    known: dict[int, Chosen] = field(default_factory=dict)

    def of(self, count: int) -> Chosen:
        """At most so many of each material."""
        if count not in self.known:
            self.known[count] = self.request.chosen(count)
        return self.known[count]
