"""Radiance's .hdr against Mitsuba's reader, against numbers by hand, and cut off."""

from __future__ import annotations

import numpy as np
import pytest

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.radiance_hdr import read_hdr
from fit_material.renderer.mitsuba.conversion import mitsuba

HEADER = b"#?RADIANCE\nEXPOSURE=1\nFORMAT=32-bit_rle_rgbe\n\n"


@pytest.fixture
def hdr(tmp_path):
    def read(data: bytes) -> np.ndarray:
        path = tmp_path / "a.hdr"
        path.write_bytes(data)
        return read_hdr(path)

    return read


def test_real_maps_are_mitsubas_bit_for_bit(shared_data):
    mi = mitsuba("scalar_rgb")
    for path in sorted((shared_data / "env").glob("*.hdr"))[:2]:
        np.testing.assert_array_equal(read_hdr(path), np.array(mi.Bitmap(str(path))))


@pytest.mark.parametrize("width", [1, 7, 8, 130, 600])
def test_what_mitsuba_writes_is_read(width, tmp_path):
    mi = mitsuba("scalar_rgb")
    picture = np.random.default_rng(2).random((5, width, 3), np.float32).round(1) * 100
    path = tmp_path / "a.hdr"
    mi.Bitmap(picture).write(str(path))
    np.testing.assert_allclose(read_hdr(path), picture, atol=picture.max() / 128)  # of the largest channel, 8 bits
    np.testing.assert_array_equal(read_hdr(path), np.array(mi.Bitmap(str(path))))


def test_plain_pixels_and_old_runs(hdr):
    """Mantissas 128, 64, 0 with the exponent 129 are 1, ½, 0; 1 1 1 n repeats n times; exponent 0 is black."""
    found = hdr(HEADER + b"-Y 1 +X 5\n" + bytes((128, 64, 0, 129, 1, 1, 1, 3, 200, 200, 200, 0)))
    np.testing.assert_array_equal(found[0], [[1, 0.5, 0]] * 4 + [[0, 0, 0]])


def test_packed_lines(hdr):
    """Eight pixels: a run of red, single greens, and so on."""
    channels = bytes((136, 128)) + bytes((8, *range(8))) + bytes((136, 0)) + bytes((130, 129, 6)) + bytes((129,) * 6)
    found = hdr(HEADER + b"-Y 1 +X 8\n" + bytes((2, 2, 0, 8)) + channels)
    np.testing.assert_array_equal(found[0], [[1, green / 128, 0] for green in range(8)])


@pytest.mark.parametrize(
    "pixels",
    [
        bytes((2, 2, 0, 8)) + bytes((255, 1)) * 4,  # runs beyond the row: Mitsuba's reader wrote on
        bytes((2, 2, 0, 8)) + bytes((0,)) * 99,  # a count of nothing
        bytes((2, 2, 0, 8)) + bytes((136, 1, 136, 1)),  # cut off
        bytes((1, 1, 1, 8)),  # a run of nothing
        bytes((9, 9, 9, 128, 1, 1, 1, 200)),  # an old run beyond the row
        b"",
    ],
)
def test_damaged_rows_are_refused(hdr, pixels):
    with pytest.raises(InputError, match=r"row 0: expected .* the file is cut off or damaged"):
        hdr(HEADER + b"-Y 1 +X 8\n" + pixels)


@pytest.mark.parametrize("data", [b"", b"P6\n", HEADER, HEADER + b"+Y 1 +X 8\n" + bytes(32), HEADER + b"-Y a +X 8\n"])
def test_other_files_are_refused(hdr, data):
    with pytest.raises(InputError, match="expected a readable HDR image"):
        hdr(data)


def test_another_colour_space_is_refused(hdr):
    with pytest.raises(InputError, match="FORMAT: expected 32-bit_rle_rgbe"):
        hdr(HEADER.replace(b"rgbe", b"xyze") + b"-Y 1 +X 1\n" + bytes(4))
