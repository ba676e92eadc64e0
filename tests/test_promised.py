"""Headers that promise more than there is: refused before anything of that size is made."""

from __future__ import annotations

import struct
import tracemalloc
import zlib

import numpy as np
import pytest

from renderer.errors import InputError
from renderer.images import read_image, write_exr
from renderer.promised import MOST_PIXELS, promised_size, require_size
from renderer.textures import read_texture

SIDE = 40_000  # 1.6e9 pixels


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(path):
    header = struct.pack(">IIBBBBB", SIDE, SIDE, 8, 2, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")
    )


def exr(path):
    write_exr(path, np.ones((2, 2, 3), np.float32))
    data, window = path.read_bytes(), struct.pack("<iiii", 0, 0, 1, 1)
    assert data.count(window) == 2  # dataWindow and displayWindow
    path.write_bytes(data.replace(window, struct.pack("<iiii", 0, 0, SIDE - 1, SIDE - 1)))


def hdr(path):
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 40000 +X 40000\n" + bytes(64))


def npy(path):
    np.save(path, np.ones((2, 2, 3), np.float32))
    path.write_bytes(path.read_bytes().replace(b"(2, 2, 3), }        ", b"(40000, 40000, 3), }"))


def tiff(path):
    from tifffile import imwrite

    imwrite(path, np.ones((2, 3, 3), np.uint8))
    data = bytearray(path.read_bytes())
    for tag in (256, 257):  # ImageWidth, ImageLength: 16-bit tag, 16-bit type, 32-bit count, 32-bit value
        (at,) = (at for kind in (3, 4) if (at := data.find(struct.pack("<HHI", tag, kind, 1))) >= 0)
        data[at : at + 12] = struct.pack("<HHII", tag, 4, 1, SIDE)
    path.write_bytes(bytes(data))


PROMISING = {".png": png, ".exr": exr, ".hdr": hdr, ".npy": npy, ".tif": tiff}


@pytest.mark.parametrize("ending", PROMISING)
def test_a_billion_pixels_are_refused_without_memory_for_them(ending, tmp_path):
    path = tmp_path / f"large{ending}"
    PROMISING[ending](path)
    assert promised_size(path) is not None
    tracemalloc.start()
    with pytest.raises(InputError, match=rf"size: is {SIDE} × {SIDE}, expected at most \d+ pixels"):
        read_image(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64 << 20


@pytest.mark.parametrize("ending", [".png", ".exr", ".npy", ".tif"])
def test_the_size_is_the_pictures(ending, tmp_path):
    path = tmp_path / f"small{ending}"
    if ending == ".exr":
        write_exr(path, np.ones((3, 5, 3), np.float32))
    elif ending == ".npy":
        np.save(path, np.ones((3, 5), np.float32))
    else:
        from imageio.v3 import imwrite

        imwrite(path, np.ones((3, 5, 3), np.uint8))
    assert promised_size(path) == (5, 3)
    assert read_image(path).radiance.shape == (3, 5, 3)


def test_the_largest_map_that_can_be_asked_for_is_taken(tmp_path):
    path = tmp_path / "map"
    with path.open("wb") as file:
        file.truncate(1 << 20)
    require_size(path, 32768, 16384)
    with pytest.raises(InputError, match=f"at most {MOST_PIXELS} pixels"):
        require_size(path, 32768, 16385)


def test_a_texture_of_pillows_is_asked_for_its_size_too(tmp_path):
    path = tmp_path / "large.bmp"
    header = struct.pack("<2sIHHI", b"BM", 54, 0, 0, 54) + struct.pack(
        "<IiiHHIIiiII", 40, SIDE, SIDE, 1, 24, 0, 0, 0, 0, 0, 0
    )
    path.write_bytes(header)
    with pytest.raises(InputError):
        read_texture(path, color=True)
