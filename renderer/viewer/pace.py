"""How coarsely a moving picture is drawn, so that it keeps up with the hand where drawing is slow."""

from __future__ import annotations

import math

FRAME = 0.05  # seconds that a frame may take while something moves
REST = 0.25  # seconds after which nothing moves any more
COARSEST = 4


class Pace:
    """Remembers how long whole pictures take, and when something last moved."""

    def __init__(self) -> None:
        self._seconds = 0.0
        self._moved = -math.inf

    def move(self, now: float) -> None:
        """Something moves; `now` in seconds."""
        self._moved = now

    def moving(self, now: float) -> bool:
        """Whether something moved just now."""
        return now - self._moved < REST

    def measure(self, seconds: float) -> None:
        """A sample of full resolution took so long."""
        self._seconds = seconds

    def coarseness(self, now: float) -> int:
        """Pixels of the display along each side of a pixel drawn; time goes with the number of those."""
        if not self.moving(now):
            return 1
        return min(COARSEST, max(1, math.ceil(math.sqrt(self._seconds / FRAME) - 0.25)))
