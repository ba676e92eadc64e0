"""How large an image file says it is, read from its first bytes: before anything is made of that size."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from renderer.errors import InputError

MOST_PIXELS = 2**29  # the largest environment map that can be asked for, 32768 × 16384
PACKED = 8256  # pixels that one byte of a file can hold at most: deflate's 1032 : 1, of one bit each


def require_size(path: Path, width: int, height: int) -> None:
    """Refuse an image that no memory holds, or that its file cannot hold: a damaged or malicious header.

    Raises:
        InputError: more pixels than `MOST_PIXELS`, or than the file can hold.
    """
    found, most = f"{width} × {height}", min(MOST_PIXELS, PACKED * path.stat().st_size)
    if width > 0 and height > 0 and width * height > most:
        raise InputError(path, "size", found, f"at most {most} pixels, which a file of this size can hold")


def promised_size(path: Path) -> tuple[int, int] | None:
    """Width and height by the file's header; None where it has none that is understood, which the reader will tell."""
    find = _HEADERS.get(path.suffix.lower())
    return None if find is None else find(path)


def _exr(path: Path) -> tuple[int, int] | None:
    """The `dataWindow` among the attributes, each a name, a type, a length, and so many bytes [OpenEXR file layout]."""
    head = _head(path)
    at = head.find(b"dataWindow\0box2i\0")
    corners = head[at + 21 : at + 37]
    if at < 0 or len(corners) < 16:
        return None
    left, top, right, bottom = (int.from_bytes(corners[i : i + 4], "little", signed=True) for i in (0, 4, 8, 12))
    return right - left + 1, bottom - top + 1


def _hdr(path: Path) -> tuple[int, int] | None:
    """The line "-Y height +X width" behind the header [Ward 1991, Radiance picture format]."""
    found = re.search(rb"^[-+]([XY]) +(\d{1,18}) +[-+][XY] +(\d{1,18})\s*$", _head(path), re.MULTILINE)
    if found is None:
        return None
    first, second = int(found[2]), int(found[3])
    return (second, first) if found[1] == b"Y" else (first, second)


def _png(path: Path) -> tuple[int, int] | None:
    """The chunk IHDR, always the first [PNG, §11.2.1]."""
    head = _head(path)
    if head[12:16] != b"IHDR":
        return None
    return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")


def _npy(path: Path) -> tuple[int, int] | None:
    """The shape in the header: rows, columns, and channels where there are several."""
    from numpy.lib import format as npy

    with path.open("rb") as file:
        version = npy.read_magic(file)
        shape = npy.read_array_header_1_0(file)[0] if version == (1, 0) else npy.read_array_header_2_0(file)[0]
    return (shape[1], shape[0]) if len(shape) in (2, 3) else None


def _tiff(path: Path) -> tuple[int, int] | None:
    from tifffile import TiffFile

    with TiffFile(path) as file:
        page = file.pages.first
        return page.imagewidth, page.imagelength


def by_pillow(path: Path) -> tuple[int, int]:
    """Pillow's, which reads pixels only when they are asked for."""
    from PIL import Image

    with Image.open(path) as picture:
        return picture.size


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(1 << 16)


_HEADERS: dict[str, Callable[[Path], tuple[int, int] | None]] = {
    ".exr": _exr,
    ".hdr": _hdr,
    ".npy": _npy,
    ".png": _png,
    ".jpg": by_pillow,
    ".jpeg": by_pillow,
    ".tif": _tiff,
    ".tiff": _tiff,
}
