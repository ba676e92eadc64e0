"""The pixels of each material, chosen once for each number of them."""

from __future__ import annotations

from dataclasses import dataclass, field

from fit_material.fitter.observations.multi_view_points import choose_points
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import Observations, choose_pixels

Chosen = list[Observations | None]
"""The pixels of each material; None where no photograph has any."""


@dataclass(frozen=True)
class PixelsByCount:
    """The pixels of one request, chosen once for each number of them: all materials are chosen together.

    Attributes:
        request: from what.
        by_points: whether to prefer points of the surface that several photographs see, for colours that vary.
        known: by number.
    """

    request: PixelRequest
    by_points: bool = False
    known: dict[int, Chosen] = field(default_factory=dict)

    def of(self, count: int) -> Chosen:
        """At most so many of each material; by points where enough of them are seen by two photographs."""
        if count not in self.known:
            self.known[count] = self._chosen(count)
        return self.known[count]

    def _chosen(self, count: int) -> Chosen:
        if not self.by_points:
            return choose_pixels(self.request, count)
        points = choose_points(self.request, count)
        if None not in points:
            return points
        return [found or pixels for found, pixels in zip(points, choose_pixels(self.request, count), strict=True)]
