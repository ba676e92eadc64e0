"""Numbers of a scene file that may be words: unknown ones, fitted beside the material, or those that EXIF gives."""

from __future__ import annotations

import re
from typing import Any, Literal

from fit_material.renderer.files.validation import unexpected

SMALLEST, LARGEST = 1e-12, 1e12  # of factors on radiances, which are of the order of 1 and float32
MOST_DEGREES = 1e6
FITTED = "fit"  # in the place of a number: it is an unknown; as encoding: the camera's curve, by several exposures


def scale_or_fit(value: Any) -> float | Literal["fit"]:
    """A factor, or "fit"."""
    if value == FITTED or _is_factor(value):
        return value
    raise unexpected(f'a number from {SMALLEST:g} to {LARGEST:g}, or "fit"')


def rotation_or_fit(value: Any) -> float | str:
    """Degrees, or "fit" or "fit:90"."""
    if _is_number(value) and abs(value) <= MOST_DEGREES:
        return value
    if isinstance(value, str) and re.fullmatch(r"fit(?::-?\d{1,6}(?:\.\d+)?)?", value):
        return value
    raise unexpected(f'a number of degrees up to {MOST_DEGREES:.0f}, or "fit", or "fit:90" to fit it near 90')


def turn_of(rotation: float | str) -> tuple[float, bool]:
    """Degrees at which a rotation stands or is looked for, and whether it is to be fitted."""
    if not isinstance(rotation, str):
        return rotation, False
    return float(rotation.partition(":")[2] or 0), True


Exposure = float | Literal["fit", "exif"] | tuple[float, ...]


def exposure_or_word(value: Any) -> Exposure:
    """A factor, "fit" or "exif"; or a factor for each of several images."""
    if isinstance(value, list | tuple):
        if value and all(map(_is_factor, value)):
            return tuple(value)
    elif value in ("fit", "exif") or _is_factor(value):
        return value
    raise unexpected(f'a number from {SMALLEST:g} to {LARGEST:g}, or "fit", or "exif", or a list beside images')


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_factor(value: Any) -> bool:
    return _is_number(value) and SMALLEST <= value <= LARGEST


WhiteBalance = Literal["fit"] | tuple[float, float, float]


def white_balance_or_fit(value: Any) -> WhiteBalance:
    """Factors of red, green and blue, or "fit"."""
    if value == FITTED:
        return value
    if isinstance(value, list | tuple) and len(value) == 3 and all(map(_is_factor, value)):
        return value[0], value[1], value[2]
    raise unexpected(f'"fit", or factors of red, green and blue from {SMALLEST:g} to {LARGEST:g}')


def fit_or_nothing(value: Any) -> Literal["fit"]:
    """ "fit"."""
    if value == FITTED:
        return value
    raise unexpected('"fit", or nothing: each of the photographs has its own')
