"""A material's numbers with their errors, in words: for the terminal, and for comments in other programs' files."""

from __future__ import annotations

from collections.abc import Iterator
from math import floor, log10
from typing import Any

from fit_material.fitter.result.schema import CHANNELS, FittedMaterial
from fit_material.shaders.materials.quantities import ALPHA, COLOR, F0, REFLECTANCE, ROUGHNESS, K, N

PARAMETERS = tuple(each.name for each in (N, K, COLOR, REFLECTANCE, F0, ALPHA, ROUGHNESS))
"""All quantities, in the order of comments and of the terminal."""
HEADLINE = tuple(each.name for each in (F0, N, K, COLOR, ALPHA))
"""Quantities that tables of many materials and sentences about one name, in their order."""


def remarks(material: FittedMaterial) -> list[str]:
    """A line for each number that the material has: values, errors, and which of them are not determined."""
    present = [key for key in PARAMETERS if getattr(material, key) is not None]
    told = [f"{key} = {', '.join(told_numbers(material, key))}{_open(material, key)}" for key in present]
    return told if material.maps is None else [*told, f"color is the mean of the colour map {material.maps.color}"]


def told_numbers(material: FittedMaterial, key: str) -> Iterator[str]:
    """A parameter's values with their errors; with the word of the catalogue where it is that one's."""
    parts = [getattr(part, key, None) for part in (material, material.stderr, material.from_prior)]
    count = 3 if isinstance(parts[0], tuple) else 1
    for value, error, taken in zip(*(_channels(part, count) for part in parts), strict=True):
        yield _with_error(value, error) if not taken else f"{_with_error(value, error, '')} (catalogue)"


def _open(material: FittedMaterial, key: str) -> str:
    """The verdict on numbers that have an error and are not determined all the same, behind them."""
    verdicts, errors = (getattr(part, key) for part in (material.determined, material.stderr))
    names = CHANNELS if isinstance(getattr(material, key), tuple) else (key,)
    each = zip(names, _channels(verdicts, len(names)), _channels(errors, len(names)), strict=True)
    unknown = [name for name, known, error in each if known is False and error is not None]
    return f"; not determined: {', '.join(unknown)}" if unknown else ""


def _with_error(value: float, error: float | None, none: str = " (not determined)") -> str:
    return f"{value:.4g} ± {error:.4g}" if error is not None else f"{value:.4g}{none}"


def decimals(error: float) -> int:
    """Decimals that show two digits of `error`, at most eight."""
    return min(max(1 - floor(log10(error)), 0), 8) if error > 0 else 4


def _channels(part: Any, count: int) -> Any:
    return part if isinstance(part, tuple) else (part,) * count


WIDTH = 160  # of the table where the output is no terminal
