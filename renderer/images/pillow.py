"""Pictures of whatever formats Pillow reads, as eight bits of red, green and blue."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from fit_material.renderer.images.image_header import DEFLATED, Size

FORMATS = (
    *("AVIF", "BMP", "DDS", "DIB", "GIF", "JPEG", "JPEG2000", "MPO", "PCX"),
    *("PNG", "PPM", "PSD", "QOI", "SGI", "TGA", "TIFF", "WEBP", "XBM", "XPM"),
)
"""Pillow's formats that are pictures of one size; of the others EPS would run Ghostscript, and ICO holds files."""


def pillow_size(path: Path) -> Size:
    """By Pillow, which reads pixels on demand."""
    with _opened(path) as picture:
        width, height = picture.size
        return Size(width, height, 3 * width * height, DEFLATED if picture.format == "PNG" else None)


def read_by_pillow(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """The first picture of several; alpha is left out."""
    with _opened(path) as picture:
        return np.array(picture.convert("RGB"))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = None  # the limit is `renderer.images.image_header.MOST_PIXELS`, of all readers
    Image.init()
    with Image.open(path, formats=[name for name in FORMATS if name in Image.OPEN]) as picture:
        yield picture
