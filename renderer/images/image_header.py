"""How large a picture may be, before anything of that size is made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fit_material.renderer.compute.memory import require_memory
from fit_material.renderer.errors.input_error import InputError

MOST_PIXELS = 2 * 10**8  # of a picture; maps of 16384 × 8192 are the largest in use
DEFLATED = 8256  # pixels that one byte of a file can hold at most: deflate's 1032 : 1, of one bit each
RADIANCE = 12  # bytes of a pixel's radiance, three float32


@dataclass(frozen=True)
class Size:
    """What a header promises.

    Attributes:
        width, height: pixels.
        stored: bytes of all samples in memory, before they become radiance.
        densest: pixels that one byte of the file holds at most; None where the format knows no such bound.
    """

    width: int
    height: int
    stored: int
    densest: int | None = None


def require_size(path: Path, size: Size) -> None:
    """Refuse a picture that is too large, that no memory holds, or that its file cannot hold.

    Raises:
        InputError: more pixels than `MOST_PIXELS` or than the file can hold, or more bytes than are free.
    """
    found, pixels = f"{size.width} × {size.height}", max(0, size.width) * max(0, size.height)
    if pixels > MOST_PIXELS:
        raise InputError(path, "size", found, f"at most {MOST_PIXELS} pixels")
    if size.densest is not None and pixels > (most := size.densest * path.stat().st_size):
        raise InputError(path, "size", found, f"at most {most} pixels, which a file of this size can hold")
    require_memory(path, size.stored + RADIANCE * pixels, "size", found)
