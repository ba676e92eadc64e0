"""OpenEXR's pictures, one part with all of its pixels."""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fit_material.renderer.compute.silence import redirected
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import FULL
from fit_material.renderer.images.image_header import DEFLATED, Size

ZIPPED = ("ZIP_COMPRESSION", "ZIPS_COMPRESSION")
SAMPLE = 4 + 4  # bytes, as OpenEXR has it and as they are stacked: of float32, for the type is read with the pixels


def exr_size(path: Path) -> Size:
    """By the headers as OpenEXR has them: the first part's size, and the bytes of all, which are read together.

    Raises:
        InputError: no whole header, or a part of samples in depth.
    """
    parts = [part.header for part in _opened(path, header_only=True).parts]
    deep = [kind for part in parts if (kind := part["type"].name).startswith("deep")]
    if deep:
        raise InputError(path, "type", deep[0], "a flat image, scanlines or tiles")
    width, height = _extent(parts[0])
    stored = sum(SAMPLE * math.prod(_extent(part)) * len(part["channels"]) for part in parts)
    return Size(width, height, stored, DEFLATED if parts[0]["compression"].name in ZIPPED else None)


def read_exr(path: Path) -> Float[np.ndarray, "h w c"]:
    """R, G, B or Y, and A where there is one, by name: their order in the file is alphabetical.

    Raises:
        InputError: no whole file, a cropped picture, or channels of other names.
    """
    with _opened(path, header_only=False) as file:  # header and pixels die with the file
        header = file.header()
        if any(np.any(a != b) for a, b in zip(header["dataWindow"], header["displayWindow"], strict=True)):
            raise InputError(path, "dataWindow", "unlike displayWindow", "the whole picture, neither cropped nor more")
        channels = {name: channel.pixels for name, channel in file.channels().items()}
        colour = next((names for names in (("R", "G", "B"), ("Y",)) if channels.keys() >= set(names)), None)
        if colour is None or {"RY", "BY"} & channels.keys():
            raise InputError(path, "channels", " ".join(channels), "R G B or Y, with or without A")
        named = [channels[name] for name in (*colour, *({"A"} & channels.keys()))]
        return np.stack(named, -1, dtype=np.float32, casting="unsafe")  # from integers, too


def write_channels(path: Path, channels: dict[str, Float[np.ndarray, "h w c"]]) -> None:
    """Write a file, deflated, and read it again: OpenEXR does not report errors of the last write.

    Raises:
        OSError: the disk takes no more.
    """
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    try:
        OpenEXR.File(header, channels).write(str(path))
    except RuntimeError as error:  # the system's reason is in its sentence alone
        code = next((code for code in FULL if os.strerror(code) in str(error)), None)
        if code is None:
            raise
        raise OSError(code, os.strerror(code)) from error
    try:
        _opened(path, header_only=False)
    except InputError as error:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from error


def _opened(path: Path, header_only: bool) -> Any:
    """The file as OpenEXR has it, its pixels read or not."""
    import OpenEXR

    with _silent():
        try:
            file = OpenEXR.File(str(path), separate_channels=True, header_only=header_only)
            file.header()  # fails where the file has no part that is whole
            return file
        except Exception as error:  # of whatever type its C++ chose
            raise InputError(path, expected="a readable EXR image; it is cut off, or no EXR") from error


def _extent(header: dict[str, Any]) -> tuple[int, int]:
    (left, top), (right, bottom) = (corner.tolist() for corner in header["dataWindow"])
    return right - left + 1, bottom - top + 1


@contextmanager
def _silent() -> Iterator[None]:
    """Nothing reaches standard output and error, where OpenEXR writes through Python and its core past it."""
    with (
        open(os.devnull, "wb") as nowhere,
        redirected((1, 2), nowhere.fileno()),
        redirect_stdout(StringIO()),
        redirect_stderr(StringIO()),
    ):
        yield
