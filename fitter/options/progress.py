"""How far a command is, as a bar on the terminal."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Told a stage of the work and the share of it that is done, in [0, 1]."""
