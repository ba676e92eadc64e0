"""n and k as known metals suggest them, where the photographs do not determine them; values alone."""

from __future__ import annotations

from dataclasses import dataclass

from fit_material.fitter.uncertainty.estimates import Measured

Triple = tuple[Measured, Measured, Measured]


@dataclass(frozen=True)
class TooFar:
    """The nearest known metal, and its distance in standard deviations, where none is near enough to be a prior."""

    nearest: str
    distance: float


@dataclass(frozen=True)
class Borrowed:
    """n and k as known metals suggest them.

    Attributes:
        metals: those they come from, with their shares, the greatest first.
        n, k: per channel; at the fitted F0.
        refused: why the catalogue did not serve as the requested prior.
    """

    metals: tuple[tuple[str, float], ...]
    n: Triple
    k: Triple
    refused: TooFar | None = None
