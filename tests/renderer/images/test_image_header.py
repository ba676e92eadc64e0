"""Headers that promise more than there is: refused before anything of that size is made."""

from __future__ import annotations

import lzma
import struct
import tracemalloc
import zlib
from contextlib import contextmanager

import numpy as np
import OpenEXR
import psutil
import pytest
from PIL import Image as PillowImage

from fit_material.renderer.compute import memory
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import read_image, write_exr
from fit_material.renderer.images.image_header import Size, require_size
from fit_material.renderer.images.samples import PNG_BEGINS, image_size
from fit_material.renderer.images.textures import read_texture
from tests.renderer.images.test_camera_raw import mosaic, write_dng

SIDE = 40_000  # 1.6e9 pixels


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(path):
    header = struct.pack(">IIBBBBB", SIDE, SIDE, 8, 2, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")
    )


def exr(path):
    """Before the attribute that counts, a text contains one like it, of two pixels."""
    write_exr(path, np.ones((2, 2, 3), np.float32))
    data, window = path.read_bytes(), struct.pack("<iiii", 0, 0, 1, 1)
    assert data.count(window) == 2  # dataWindow and displayWindow
    data = data.replace(window, struct.pack("<iiii", 0, 0, SIDE - 1, SIDE - 1))
    text = b"dataWindow\0box2i\0" + struct.pack("<i", 16) + window
    path.write_bytes(data[:8] + b"comments\0string\0" + struct.pack("<i", len(text)) + text + data[8:])


def hdr(path):
    """Before the size that counts, the header has a line that looks like one."""
    path.write_bytes(b"#?RADIANCE\n-Y 8 +X 16\nFORMAT=32-bit_rle_rgbe\n\n-Y 40000 +X 40000\n" + bytes(64))


def npy(path):
    np.save(path, np.ones((2, 2, 3), np.float32))
    path.write_bytes(path.read_bytes().replace(b"(2, 2, 3), }        ", b"(40000, 40000, 3), }"))


def tiff(path):
    from tifffile import imwrite

    imwrite(path, np.ones((2, 3, 3), np.uint8))
    with_size(path)


def with_size(path):
    data = bytearray(path.read_bytes())
    for tag in (256, 257):  # ImageWidth, ImageLength: 16-bit tag, 16-bit type, 32-bit count, 32-bit value
        (at,) = (at for kind in (3, 4) if (at := data.find(struct.pack("<HHI", tag, kind, 1))) >= 0)
        data[at : at + 12] = struct.pack("<HHII", tag, 4, 1, SIDE)
    path.write_bytes(bytes(data))


PROMISING = {".png": png, ".exr": exr, ".hdr": hdr, ".npy": npy, ".tif": tiff}


def jpeg(path):
    PillowImage.new("RGB", (2, 2)).save(path, "jpeg")
    data = bytearray(path.read_bytes())
    at = data.index(b"\xff\xc0") + 5  # start of frame: marker, length, precision, then rows and columns
    data[at : at + 4] = struct.pack(">HH", SIDE, SIDE)
    path.write_bytes(bytes(data))


def bmp(path):
    header = struct.pack("<2sIHHI", b"BM", 54, 0, 0, 54) + struct.pack(
        "<IiiHHIIiiII", 40, SIDE, SIDE, 1, 24, 0, 0, 0, 0, 0, 0
    )
    path.write_bytes(header)


def dng(path):
    """Sizes of TIFF's, in LibRaw's hands."""
    write_dng(path, mosaic((0.1, 0.2, 0.3)))
    with_size(path)


def webp(path):
    """The lossless kind: sizes less one, of 14 bits each, behind the signature."""
    PillowImage.new("RGB", (2, 2)).save(path, "webp", lossless=True)
    data = bytearray(path.read_bytes())
    at = data.index(b"VP8L") + 9
    data[at : at + 4] = struct.pack("<I", (1 << 28) - 1)
    path.write_bytes(bytes(data))


PROMISING = {".png": png, ".exr": exr, ".hdr": hdr, ".npy": npy, ".tif": tiff, ".jpg": jpeg, ".dng": dng}


@pytest.mark.parametrize("ending", PROMISING)
def test_a_billion_pixels_are_refused_without_memory_for_them(ending, tmp_path):
    path = tmp_path / f"large{ending}"
    PROMISING[ending](path)
    with little_memory(), pytest.raises(InputError) as refusal:
        read_image(path)
    assert str(refusal.value) == f"{path}: size: is {SIDE} × {SIDE}, expected at most 200000000 pixels"


@pytest.mark.parametrize(
    ("ending", "write", "size"), [(".bmp", bmp, f"{SIDE} × {SIDE}"), (".webp", webp, "16384 × 16384")]
)
def test_pictures_that_only_textures_are_made_of_are_limited_too(ending, write, size, tmp_path):
    path = tmp_path / f"large{ending}"
    write(path)
    with little_memory(), pytest.raises(InputError) as refusal:
        read_texture(path, color=True)
    assert str(refusal.value) == f"{path}: size: is {size}, expected at most 200000000 pixels"


@contextmanager
def little_memory():
    """Python's own memory stays below 64 MB, and the process grows by no more."""
    before = psutil.Process().memory_info().rss
    tracemalloc.start()
    try:
        yield
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 64 << 20
    assert psutil.Process().memory_info().rss - before < 256 << 20  # with the library that reads the format


def test_a_png_of_zeros_that_its_file_can_hold_is_refused(tmp_path):
    """A bomb of 400 million pixels, which is a whole file of 48 kB."""
    side = 20000
    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(1 + side // 8)) for _ in range(side)) + packer.flush()
    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    path = tmp_path / "zeros.png"
    path.write_bytes(PNG_BEGINS + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b""))
    with pytest.raises(InputError, match="size: is 20000 × 20000, expected at most 200000000 pixels"):
        read_image(path)


def test_what_memory_does_not_hold_is_refused_with_both_numbers(tmp_path, monkeypatch):
    """A TIFF of 12000² pixels of three doubles: 24 bytes each as they are stored, and 12 as radiance."""
    from tifffile import imwrite

    path = tmp_path / "zeros.tif"
    imwrite(path, shape=(12000, 12000, 3), dtype=np.float64)  # written as a hole
    monkeypatch.setattr(memory, "available_memory", lambda: 3 * 10**9)
    with pytest.raises(InputError) as refusal:
        read_image(path)
    expected = "what fits into memory: reading it takes 5.18 GB, and 3 GB are free"
    assert str(refusal.value) == f"{path}: size: is 12000 × 12000, expected {expected}"


@pytest.mark.parametrize("kind", ["zlib", "lzma"])
def test_a_tiffs_strip_that_holds_more_than_the_picture_is_not_unpacked(kind, tmp_path):
    path = tmp_path / "bomb.tif"
    packer = lzma.LZMACompressor(preset=0) if kind == "lzma" else zlib.compressobj(1)
    bomb = b"".join([*(packer.compress(bytes(1 << 24)) for _ in range(32)), packer.flush()])  # half a gigabyte of zeros
    with_strip(path, kind, bomb)
    with little_memory(), pytest.raises(InputError) as refusal:
        read_image(path)
    assert str(refusal.value) == f"{path}: expected strips of no more than the picture's 768 bytes"


def with_strip(path, kind: str, strip: bytes) -> None:
    """A TIFF of 16² pixels, whose only strip is replaced."""
    from tifffile import TiffFile, imwrite

    imwrite(path, np.zeros((16, 16, 3), np.uint8), compression=kind, rowsperstrip=16)
    with TiffFile(path) as file:
        start, count = (file.pages.first.tags[tag] for tag in (273, 279))  # StripOffsets, StripByteCounts
    assert (start.dtype, count.dtype) == (4, 4)
    data = bytearray(path.read_bytes())
    data[start.valueoffset : start.valueoffset + 4] = struct.pack("<I", len(data))
    data[count.valueoffset : count.valueoffset + 4] = struct.pack("<I", len(strip))
    path.write_bytes(bytes(data) + strip)


@pytest.mark.parametrize(("window", "read"), [(1 << 26, True), (1 << 30, False)])
def test_a_few_bytes_of_lzma_do_not_ask_for_a_gigabyte_of_memory(window, read, tmp_path):
    """The container of .lzma: one byte of properties, then the window's size in four. 64 MiB are preset 9's."""
    path = tmp_path / "window.tif"
    packed = lzma.compress(np.full(768, 77, np.uint8).tobytes(), format=lzma.FORMAT_ALONE)
    with_strip(path, "lzma", packed[:1] + struct.pack("<I", window) + packed[5:])
    if read:
        np.testing.assert_array_equal(read_image(path, "linear").radiance * 255, np.full((16, 16, 3), 77))
        return
    with pytest.raises(InputError) as refusal:
        read_image(path)
    assert str(refusal.value) == f"{path}: expected a readable TIF image (Memory usage limit exceeded)"


@pytest.mark.parametrize(("number", "name"), [(50000, "ZSTD"), (7, "JPEG"), (34887, "LERC"), (12345, "12345")])
def test_a_tiff_of_another_compression_is_refused_whatever_codecs_are_installed(number, name, tmp_path):
    from tifffile import TiffFile, imwrite

    path = tmp_path / "a.tif"
    imwrite(path, np.zeros((16, 16, 3), np.uint8))
    with TiffFile(path) as file:
        at = file.pages.first.tags[259].valueoffset  # Compression
    data = bytearray(path.read_bytes())
    data[at : at + 2] = struct.pack("<H", number)
    path.write_bytes(bytes(data))
    with pytest.raises(InputError) as refusal:
        read_image(path)
    assert str(refusal.value) == f"{path}: compression: is {name}, expected none, LZW, PackBits, deflate or LZMA"


def test_pictures_of_one_colour_are_read_however_few_bytes_they_take(tmp_path):
    """Which no bound of deflate's holds for: 16.8 million pixels in some hundred bytes, or a few thousand."""
    from tifffile import imwrite

    PillowImage.new("RGB", (4096, 4096), "white").save(tmp_path / "white.webp", lossless=True)
    imwrite(tmp_path / "white.tif", np.full((4096, 4096), 255, np.uint8), compression="lzma", rowsperstrip=4096)
    for path in (tmp_path / "white.webp", tmp_path / "white.tif"):
        assert path.stat().st_size < 4096
    assert (read_texture(tmp_path / "white.webp", color=True).texels == 1).all()
    assert (read_image(tmp_path / "white.tif", "linear").radiance == 1).all()


@pytest.mark.parametrize("ending", [".png", ".tif", ".exr"])
def test_what_deflate_cannot_have_packed_is_refused_by_the_length_of_its_file(ending, tmp_path, monkeypatch):
    """Of a picture of zeros, whose header then promises 10000² pixels; memory would hold them."""
    path = tmp_path / f"large{ending}"
    monkeypatch.setattr("tests.renderer.images.test_image_header.SIDE", 10000)
    monkeypatch.setattr(memory, "available_memory", lambda: 10**11)
    if ending == ".tif":
        from tifffile import imwrite

        imwrite(path, np.ones((2, 3, 3), np.uint8), compression="zlib")
        with_size(path)
    else:
        PROMISING[ending](path)
    with little_memory(), pytest.raises(InputError) as refusal:
        read_image(path)
    most = 8256 * path.stat().st_size  # 1032 bytes of a bit a pixel
    expected = f"expected at most {most} pixels, which a file of this size can hold"
    assert str(refusal.value) == f"{path}: size: is 10000 × 10000, {expected}"


def test_both_copies_of_an_exr_s_floats_are_counted(tmp_path):
    """OpenEXR's samples, and the array that they are stacked in."""
    path = tmp_path / "a.exr"
    write_exr(path, np.random.default_rng(0).random((512, 512, 4), np.float32))
    assert image_size(path).stored == 512 * 512 * 4 * (4 + 4)


@pytest.mark.parametrize("kind", ["zlib", "lzma", None])
def test_tiffs_whose_strips_are_densely_packed_are_read(kind, tmp_path):
    """Of one grey, and of noise, whose packed strip is long; many strips and one."""
    from tifffile import imwrite

    noise = np.random.default_rng(0).integers(0, 256, (300, 400, 3), np.uint8)
    for samples in (np.full_like(noise, 77), noise):
        for rows in (1, 300):
            imwrite(tmp_path / "a.tif", samples, compression=kind, rowsperstrip=rows)
            np.testing.assert_array_equal(read_image(tmp_path / "a.tif", "linear").radiance * 255, samples)


def test_the_tiles_of_a_tiff_count_which_are_unpacked_whole(tmp_path):
    from tifffile import TiffFile, imwrite

    path = tmp_path / "tiles.tif"
    imwrite(path, np.zeros((16, 16, 3), np.uint8), compression="zlib", tile=(16, 16))
    with TiffFile(path) as file:
        places = [file.pages.first.tags[tag].valueoffset for tag in (322, 323)]  # TileWidth, TileLength
    data = bytearray(path.read_bytes())
    for at in places:
        data[at : at + 4] = struct.pack("<I", 1 << 20)
    path.write_bytes(bytes(data))
    with pytest.raises(
        InputError, match=r"size: is 16 × 16, expected what fits into memory: reading it takes 3.3e\+03 GB"
    ):
        read_image(path)


@pytest.mark.parametrize(
    ("shape", "dtype", "sentence"),
    [
        ((2, 3, 10**12), "<f4", "size: is 3 × 2, expected what fits into memory: reading it takes 2.4e+04 GB, and "),
        ((10**12,), "<f4", "size: is 1 × 1000000000000, expected at most 200000000 pixels"),
        (
            (1000, 1000),
            "|V1000000000",
            "size: is 1000 × 1000, expected what fits into memory: reading it takes 1e+06 GB",
        ),
        ((1000, 1000, 3), "<f4", "expected a readable NPY image (it is cut off)"),
        ((2, 2), "|O", "expected a readable NPY image ("),
    ],
)
def test_an_array_that_its_file_does_not_hold_is_refused(shape, dtype, sentence, tmp_path):
    path = tmp_path / "a.npy"
    text = repr({"descr": dtype, "fortran_order": False, "shape": shape}).ljust(117) + "\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + bytes(64))
    with little_memory(), pytest.raises(InputError) as refusal:
        read_image(path)
    assert str(refusal.value).startswith(f"{path}: {sentence}")


def test_every_part_of_an_exr_counts_which_are_read_together(tmp_path):
    path = tmp_path / "parts.exr"
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    pixels = {name: np.ones((4, 5), np.float32) for name in "RGB"}
    parts = [OpenEXR.Part({**header, "name": name}, pixels) for name in ("a", "b")]
    OpenEXR.File(parts).write(str(path))
    data, window = path.read_bytes(), struct.pack("<iiii", 0, 0, 4, 3)
    assert data.count(window) == 4  # dataWindow and displayWindow of each
    at = data.rindex(b"dataWindow\0box2i\0") + 21
    path.write_bytes(data[:at] + struct.pack("<iiii", 0, 0, 999_999, 999_999) + data[at + 16 :])
    with pytest.raises(
        InputError, match=r"size: is 5 × 4, expected what fits into memory: reading it takes 2.4e\+04 GB"
    ):
        read_image(path)


@pytest.mark.parametrize("ending", [".png", ".exr", ".npy", ".tif", ".jpg", ".hdr", ".dng"])
def test_the_size_is_the_pictures(ending, tmp_path):
    path = tmp_path / f"small{ending}"
    if ending == ".exr":
        write_exr(path, np.ones((32, 48, 3), np.float32))
    elif ending == ".npy":
        np.save(path, np.ones((32, 48), np.float32))
    elif ending == ".hdr":
        pixels = bytes((128, 128, 128, 129)) * 48 * 32
        path.write_bytes(b"#?RADIANCE\n-Y 8 +X 16\nFORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 48\n" + pixels)
    elif ending == ".dng":
        write_dng(path, mosaic((0.1, 0.2, 0.3)))
    else:
        from imageio.v3 import imwrite

        imwrite(path, np.ones((32, 48, 3), np.uint8))
    size = image_size(path)
    assert (size.width, size.height) == (48, 32)
    assert read_image(path).radiance.shape == (32, 48, 3)


def test_the_largest_map_in_use_is_taken_and_none_of_more_pixels(tmp_path):
    path = tmp_path / "map"
    with path.open("wb") as file:
        file.truncate(1 << 20)
    require_size(path, Size(16384, 8192, 0))
    require_size(path, Size(20000, 10000, 0))
    with pytest.raises(InputError, match="expected at most 200000000 pixels"):
        require_size(path, Size(20000, 10001, 0))


def test_a_jpeg_of_a_hundred_megapixels_is_read_without_a_warning(tmp_path):
    """Pillow's own limit warns from 89 million on."""
    path = tmp_path / "large.jpg"
    PillowImage.new("L", (10000, 10000), 128).save(path)
    assert image_size(path) == Size(10000, 10000, 3 * 10**8)


def test_a_png_that_is_a_jpeg_is_read_and_limited(tmp_path):
    path = tmp_path / "a.png"
    PillowImage.new("RGB", (5, 4), (255, 0, 0)).save(path, "jpeg")
    assert read_image(path).radiance.shape == (4, 5, 3)
    jpeg(path)
    with pytest.raises(InputError, match=f"size: is {SIDE} × {SIDE}, expected at most 200000000 pixels"):
        read_image(path)


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.eps"])
def test_pillow_hands_no_file_to_ghostscript(name, tmp_path, monkeypatch):
    """Which it does with PostScript, whatever the file's name is."""
    monkeypatch.setattr("subprocess.Popen", lambda *arguments, **options: pytest.fail("a program was started"))
    monkeypatch.setattr("subprocess.check_call", lambda *arguments, **options: pytest.fail("a program was started"))
    monkeypatch.setattr("PIL.EpsImagePlugin.gs_binary", "gs")
    path = tmp_path / name
    path.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 8 8\n%%EndComments\nshowpage\n%%EOF\n")
    with pytest.raises(InputError, match=r"readable|a format that Pillow reads"):
        read_texture(path, color=True)


def test_six_faces_whose_map_is_too_large_are_refused_before_they_are_read(tmp_path):
    """Of 100 million pixels each, and 800 million of the map."""
    for name in ("px", "nx", "py", "ny", "pz", "nz"):
        PillowImage.new("L", (8, 8)).save(tmp_path / f"{name}.jpg")
        data = bytearray((tmp_path / f"{name}.jpg").read_bytes())
        at = data.index(b"\xff\xc0") + 5
        data[at : at + 4] = struct.pack(">HH", 10000, 10000)
        (tmp_path / f"{name}.jpg").write_bytes(bytes(data) + bytes(20000))
    with pytest.raises(InputError) as refusal:
        read_environment(tmp_path)
    assert str(refusal.value) == f"{tmp_path}: size: is 40000 × 20000, expected at most 200000000 pixels"
