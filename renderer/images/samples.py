"""Picture files as they are stored: one gate before all readers, behind which a picture fits into memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Num

from fit_material.renderer.backends.mitsuba_library import mitsuba_library
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import require_file
from fit_material.renderer.images.camera_raw import ENDINGS, raw_size, read_raw
from fit_material.renderer.images.exr import exr_size, read_exr
from fit_material.renderer.images.image_header import DEFLATED, Size, require_size
from fit_material.renderer.images.pillow import pillow_size, read_by_pillow
from fit_material.renderer.images.radiance_hdr import hdr_size, read_hdr
from fit_material.renderer.images.tiff import read_tiff, tiff_size

PNG_BEGINS = b"\x89PNG\r\n\x1a\n"
PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}  # by colour type, palettes applied [PNG, §11.2.1]

Samples = Num[np.ndarray, "h w *c"]
T = TypeVar("T")


class Format(NamedTuple, Generic[T]):
    """How files of a format are read: their size by the header that the reader goes by, then all of them."""

    size: Callable[[Path], Size]
    read: Callable[[Path], T]


def read_samples(path: Path) -> Samples:
    """The samples of a picture file, unsigned integers or floats.

    Raises:
        InputError: the file is missing, broken, of another format, too large, or no regular file.
    """
    known = _FORMATS.get(path.suffix.lower())
    if known is None:
        raise InputError(path, "format", path.suffix or "missing", f"one of {' '.join(FORMATS)}")
    return _checked(known, path)


def read_sensor(path: Path) -> tuple[Float[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    """A camera raw file, as `read_raw` has it; raises what `read_samples` does."""
    return _checked(_RAW, path)


def read_any(path: Path) -> Samples:
    """A picture of whatever format Pillow reads, as `read_by_pillow` has it; raises what `read_samples` does."""
    return _checked(_PILLOW, path, "a picture of a format that Pillow reads")


def image_size(path: Path) -> Size:
    """The size by its header of a file that `read_samples` or `read_sensor` reads; raises what they do."""
    return _promised(_RAW if path.suffix.lower() in ENDINGS else _FORMATS[path.suffix.lower()], path)


def _checked(known: Format[T], path: Path, what: str = "") -> T:
    """What a format's reader makes of a file that memory holds."""
    _promised(known, path, what)
    with _readable(path, what):
        return known.read(path)


def _promised(known: Format[Any], path: Path, what: str = "") -> Size:
    """The size of a file that memory holds."""
    require_file(path, "an image file")
    with _readable(path, what):
        found = known.size(path)
    require_size(path, found)
    return found


@contextmanager
def _readable(path: Path, what: str) -> Iterator[None]:
    """A broken file becomes an InputError; `what` was expected, a readable one where that is empty."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # the parsers of so many formats raise whatever they like on foreign bytes
        reason = f"{error}".partition("\n")[0].strip().rstrip(".") or type(error).__name__
        raise InputError(path, expected=what or f"a readable {path.suffix[1:].upper()} image ({reason})") from error


def _png_size(path: Path) -> Size:
    """The chunk IHDR, always the first [PNG, §11.2.1]."""
    if not _is_png(path):
        return pillow_size(path)
    with path.open("rb") as file:
        head = file.read(26)
    if head[12:16] != b"IHDR" or len(head) < 26 or head[25] not in PNG_CHANNELS:
        raise ValueError("its first chunk is no IHDR")
    width, height = int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
    stored = width * height * PNG_CHANNELS[head[25]] * (2 if head[24] == 16 else 1)
    return Size(width, height, stored, DEFLATED)


def _read_png(path: Path) -> Samples:
    """PNG through Mitsuba, which keeps 16 bits at 16 bits and expands palettes."""
    if not _is_png(path):
        return read_by_pillow(path)
    mi = mitsuba_library()

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)  # libpng warns of colour profiles, which are not used, on standard output
    return np.array(mi.Bitmap(str(path)))


def _is_png(path: Path) -> bool:
    """By its first bytes: many a .png is a JPEG."""
    with path.open("rb") as file:
        return file.read(len(PNG_BEGINS)) == PNG_BEGINS


def _npy_size(path: Path) -> Size:
    from numpy.lib import format as npy

    with path.open("rb") as file:
        version = npy.read_magic(file)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, dtype = read(file)
    rows, columns, *_ = (*shape, 1, 1)
    return Size(columns, rows, math.prod(shape) * dtype.itemsize)


def _read_npy(path: Path) -> Samples:
    if _npy_size(path).stored > path.stat().st_size:
        raise ValueError("it is cut off")
    array = np.load(path, allow_pickle=False)
    if array.dtype.kind != "f":
        raise InputError(path, "dtype", array.dtype, "floats, linear radiance")
    return array


_PILLOW = Format(pillow_size, read_by_pillow)
_RAW = Format(raw_size, read_raw)
_FORMATS: dict[str, Format[Samples]] = {
    ".exr": Format(exr_size, read_exr),
    ".hdr": Format(hdr_size, read_hdr),
    ".npy": Format(_npy_size, _read_npy),
    ".png": Format(_png_size, _read_png),
    ".jpg": _PILLOW,
    ".jpeg": _PILLOW,
    ".tif": Format(tiff_size, read_tiff),
    ".tiff": Format(tiff_size, read_tiff),
}

FORMATS = (*_FORMATS, *ENDINGS)
