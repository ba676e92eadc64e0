"""Quantities of materials as data. No torch, so that the command line may read it at once."""

from __future__ import annotations

from typing import Literal

MaterialType = Literal["metal", "glossy", "matte"]
