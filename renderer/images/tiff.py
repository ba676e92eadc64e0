"""TIFF files: the first page, as tifffile reads it."""

from __future__ import annotations

import lzma
import math
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Num

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_header import DEFLATED, Size

HARMLESS = 1 << 16  # bytes of a deflated strip, of which 68 MB can become
STEP = 1 << 24  # bytes that are unpacked at once
LZMA_MEMORY = 1 << 27  # bytes of its window and tables; its densest preset takes 65 MiB


def tiff_size(path: Path) -> Size:
    """By the first page's header. A tile is read whole, however small the picture.

    Raises:
        InputError: a compression whose strips cannot be measured before they are read.
    """
    from tifffile import TiffFile

    with TiffFile(path) as file:
        page = file.pages.first
        _require_known_compression(path, page.compression)
        densest = DEFLATED if page.compression in _deflated() else None
        return Size(page.imagewidth, page.imagelength, max(page.nbytes, _segment(page)), densest)


def read_tiff(path: Path) -> Num[np.ndarray, "h w *c"]:
    """Samples as they are stored, a palette applied.

    Raises:
        InputError: neither RGB, grey nor palette; or strips that hold more than the picture.
    """
    from tifffile import PHOTOMETRIC, TiffFile

    with TiffFile(path) as file:
        page = file.pages.first
        _require_honest_strips(path, page)
        samples = page.asarray()
        palette = page.colormap
    if page.axes.startswith("S"):  # channels stored as planes
        samples = np.moveaxis(samples, 0, -1)
    if samples.dtype == bool:
        samples = samples.astype(np.uint8) * np.uint8(255)
    if palette is not None:
        return np.moveaxis((palette >> 8).astype(np.uint8)[:, samples], 0, -1)  # 16-bit tables of 8-bit colours
    if page.photometric == PHOTOMETRIC.MINISWHITE:
        return np.iinfo(samples.dtype).max - samples
    if page.photometric not in (PHOTOMETRIC.MINISBLACK, PHOTOMETRIC.RGB):
        raise InputError(path, "photometric", PHOTOMETRIC(page.photometric).name, "RGB, grey or palette")
    return samples


def _segment(page: Any) -> int:
    """Bytes of a tile, unpacked; of a strip no more than of the page."""
    return math.prod(page.chunks) * page.dtype.itemsize if page.is_tiled and page.dtype is not None else 0


def _require_known_compression(path: Path, compression: int) -> None:
    """tifffile hands others to whatever codecs are installed, which unpack as much as they like."""
    from tifffile import COMPRESSION

    others = (COMPRESSION.NONE, COMPRESSION.LZW, COMPRESSION.PACKBITS, COMPRESSION.LZMA)
    if compression not in (*others, *_deflated()):
        name = getattr(compression, "name", compression)
        raise InputError(path, "compression", name, "none, LZW, PackBits, deflate or LZMA")


def _deflated() -> tuple[int, ...]:
    """Both numbers of deflate."""
    from tifffile import COMPRESSION

    return COMPRESSION.ADOBE_DEFLATE, COMPRESSION.DEFLATE


def _require_honest_strips(path: Path, page: Any) -> None:
    """tifffile unpacks strips and tiles whole, whatever the header promises of them."""
    unpacked, most = _unpacking(page.compression), max(page.nbytes, _segment(page))
    if unpacked is None:
        return
    harmless = HARMLESS if unpacked is _inflated else 0  # a few bytes of LZMA can require gigabytes of memory
    with path.open("rb") as file:
        for start, count in zip(page.dataoffsets, page.databytecounts, strict=True):
            if count > harmless:
                file.seek(start)
                _require_at_most(most, unpacked(file.read(count)), path)


def _require_at_most(most: int, pieces: Iterator[bytes], path: Path) -> None:
    made = 0
    for piece in pieces:
        made += len(piece)
        if made > most:
            raise InputError(path, expected=f"strips of no more than the picture's {most} bytes")


def _unpacking(compression: int) -> Callable[[bytes], Iterator[bytes]] | None:
    """What takes a strip apart piece by piece; None where none can be much larger than its file."""
    from tifffile import COMPRESSION

    return _inflated if compression in _deflated() else _from_lzma if compression == COMPRESSION.LZMA else None


def _inflated(data: bytes) -> Iterator[bytes]:
    unpacker = zlib.decompressobj()
    while data and not unpacker.eof:
        yield unpacker.decompress(data, STEP)
        data = unpacker.unconsumed_tail


def _from_lzma(data: bytes) -> Iterator[bytes]:
    unpacker = lzma.LZMADecompressor(memlimit=LZMA_MEMORY)
    yield unpacker.decompress(data, STEP)
    while not (unpacker.eof or unpacker.needs_input):
        yield unpacker.decompress(b"", STEP)
