"""Whoever works calls this: how far a stage is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with the stage of the work and the fraction of it that is done, in [0, 1]."""
