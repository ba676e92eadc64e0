"""Radiance's .hdr pictures: one exponent for three mantissas, packed by runs [Ward 1991; Real Pixels].

Mitsuba's reader writes beyond its memory where runs are longer than their line; this one refuses such a file.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float, UInt8

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_bytes
from fit_material.renderer.images.image_header import Size

EXCESS = 128 + 8  # of the exponent, for mantissas of eight bits
LONGEST_HEAD = 1 << 16  # bytes
STORED = 4 + 4 + 4  # bytes of a pixel: samples, its exponent, and that as a factor
SHORTEST, LONGEST = 8, 0x7FFF  # lines that may be packed channel by channel

_RESOLUTION = re.compile(rb"-Y +(\d{1,9}) +\+X +(\d{1,9})[ \t]*\r?\n")


def hdr_size(path: Path) -> Size:
    """By the lines that `read_hdr` goes by; raises what it does of them."""
    with path.open("rb") as file:
        height, width = _layout(path, file)
    return Size(width, height, STORED * width * height)


def read_hdr(path: Path) -> Float[np.ndarray, "h w 3"]:
    """Linear radiance, m · 2^(e - 136).

    Raises:
        InputError: the file is no such picture, is rotated or mirrored, or ends or runs over before its last pixel.
    """
    with path.open("rb") as file:
        height, width = _layout(path, file)
        start = file.tell()
    data = read_bytes(path)
    lines = np.empty((height, width, 4), np.uint8)
    for row in range(height):
        start = _read_line(path, data, start, lines[row], row)
    scale = np.ldexp(np.float32(1), lines[..., 3:].astype(np.int32) - EXCESS)
    return lines[..., :3] * np.where(lines[..., 3:] > 0, scale, np.float32(0))


def _layout(path: Path, file: BinaryIO) -> tuple[int, int]:
    """How many rows and columns there are; the file then stands where pixels begin.

    Raises:
        InputError: the file is no such picture, or one that is rotated or mirrored.
    """
    data = file.read(LONGEST_HEAD)
    head = re.match(rb"#\?[^\n]*\n(?:[^\n]+\n)*?\r?\n", data)
    resolution = _RESOLUTION.match(data, head.end()) if head else None
    if head is None or resolution is None:
        raise InputError(
            path, expected='a readable HDR image: "#?RADIANCE", and "-Y height +X width" behind an empty line'
        )
    if b"FORMAT=" in head[0] and b"FORMAT=32-bit_rle_rgbe" not in head[0]:
        raise InputError(path, "FORMAT", expected="32-bit_rle_rgbe")
    height, width = int(resolution[1]), int(resolution[2])
    file.seek(resolution.end())
    return height, width


def _read_line(path: Path, data: bytes, at: int, line: UInt8[np.ndarray, "w 4"], row: int) -> int:
    """Fill one line; where the next one begins."""
    width = len(line)
    packed = SHORTEST <= width <= LONGEST and data[at : at + 4] == bytes((2, 2, width >> 8, width & 0xFF))
    if not packed:
        return _read_plain(path, data, at, line, row)
    at += 4
    for channel in range(4):
        values, at = _unpacked(data, at, width)
        if len(values) != width:
            raise InputError(path, f"row {row}", expected="runs that end with the row; the file is cut off or damaged")
        line[:, channel] = np.frombuffer(values, np.uint8)
    return at


def _unpacked(data: bytes, at: int, width: int) -> tuple[bytes, int]:
    """One channel of a line, `width` bytes of it unless it is damaged, and where the next one begins.

    A count above 128 repeats the next byte, another one copies as many.
    """
    parts, filled = [], 0
    while filled < width and at < len(data):
        count = data[at]
        if count > 128:
            count -= 128
            parts.append(data[at + 1 : at + 2] * count)
            at += 2
        else:
            parts.append(data[at + 1 : at + 1 + count])
            at += 1 + count
        if count == 0:  # it would never end
            break
        filled += count
    return b"".join(parts), at


def _read_plain(path: Path, data: bytes, at: int, line: UInt8[np.ndarray, "w 4"], row: int) -> int:
    """A line of whole pixels; one of mantissas 1, 1, 1 repeats the one before as often as its exponent."""
    filled, shift = 0, 0
    while filled < len(line):
        pixel = data[at : at + 4]
        repeat = pixel[:3] == b"\1\1\1"
        count = pixel[3] << shift if repeat and len(pixel) == 4 else 1
        if len(pixel) < 4 or (repeat and filled == 0) or count > len(line) - filled or shift > 24:
            raise InputError(path, f"row {row}", expected="pixels up to the row's end; the file is cut off or damaged")
        line[filled : filled + count] = line[filled - 1] if repeat else np.frombuffer(pixel, np.uint8)
        filled, at, shift = filled + count, at + 4, shift + 8 if repeat else 0
    return at
