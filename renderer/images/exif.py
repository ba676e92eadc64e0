"""What a camera wrote into a file beside the picture: which way up it was held, and how much light it let in."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Shaped

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import require_regular

UPRIGHT = 1  # EXIF's orientation of a picture whose first row is its upper one

ISO_OF_ONE = 100.0  # the sensitivity that counts as exposure 1, with one second at f/1


@dataclass(frozen=True)
class Exif:
    """A file's EXIF entries.

    Attributes:
        orientation: 1 to 8 [EXIF 2.3, table 6]; 1 where there is none.
        seconds: exposure time; None where there is none, as of the next two.
        aperture: f-number N, focal length over the diameter of the entrance pupil.
        iso: sensitivity S.
    """

    orientation: int = UPRIGHT
    seconds: float | None = None
    aperture: float | None = None
    iso: float | None = None


def read_exif(path: Path) -> Exif:
    """The entries of a file; without any where it has none, or none that can be read."""
    import exifread

    logging.getLogger("exifread").setLevel(logging.CRITICAL)  # it would warn of every file without
    require_regular(path)
    try:
        with path.open("rb") as file:
            tags = exifread.process_file(file, details=False, extract_thumbnail=False)
    except Exception:  # of whatever type the parsers of its formats choose on foreign bytes
        return Exif()
    orientation = _number(tags, "Orientation") or UPRIGHT
    return Exif(
        int(orientation) if orientation <= 8 else UPRIGHT,
        *(_number(tags, name) for name in ("ExposureTime", "FNumber", "ISOSpeedRatings")),
    )


def relative_exposure(path: Path) -> float:
    """How much light a photograph's camera let in and made of it: what its pixels are over the radiance.

        E = t · S / (100 N²)        [ISO 2720, of a reflected-light meter; constants left out]

    An aperture or sensitivity that the file lacks, as of lenses without a contact, counts as f/1 and ISO 100.

    Raises:
        InputError: the file has no exposure time.
    """
    exif = read_exif(path)
    if exif.seconds is None:
        raise InputError(path, "ExposureTime", expected="it in the file's EXIF, or the exposure given as a number")
    return exif.seconds * (exif.iso or ISO_OF_ONE) / ISO_OF_ONE / (exif.aperture or 1.0) ** 2


def upright(samples: Shaped[np.ndarray, "h w *c"], orientation: int) -> Shaped[np.ndarray, "a b *c"]:
    """The picture as it was seen, of samples as a file stores them.

    Args:
        orientation: EXIF's, the place of the stored first row and first column.
    """
    if orientation in (5, 6, 7, 8):  # the first row is a side
        samples = samples.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        samples = samples[::-1]
    if orientation in (2, 3, 6, 7):
        samples = samples[:, ::-1]
    return np.ascontiguousarray(samples)


def _number(tags: dict[str, Any], name: str) -> float | None:
    """A positive number of the file, in EXIF's table or, as in raw files, in the picture's; None where it has none."""
    tag = tags.get(f"EXIF {name}") or tags.get(f"Image {name}")
    try:
        value = float(Fraction(tag.values[0]))  # type: ignore[union-attr] — None has no values
    except (AttributeError, IndexError, TypeError, ValueError, ArithmeticError):
        return None
    return value if 0 < value < float("inf") else None
