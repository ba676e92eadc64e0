"""What is read back, against what other programs wrote and what the curves' definitions say."""

import errno
import os
import subprocess
import sys
import zlib

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image as PillowImage

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import read_image, write_exr
from tests.support.srgb_curve import decoded


def codes(shape, bits: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 2**bits, shape).astype(f"uint{bits}")


def write_png16(path, samples: np.ndarray) -> None:
    """A PNG as its specification says, byte by byte: no library at hand writes 16-bit RGB."""

    def chunk(name: bytes, data: bytes) -> bytes:
        check = zlib.crc32(name + data).to_bytes(4, "big")
        return len(data).to_bytes(4, "big") + name + data + check

    height, width = samples.shape[:2]
    size = width.to_bytes(4, "big") + height.to_bytes(4, "big")
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in samples)
    head = chunk(b"IHDR", size + bytes([16, 2, 0, 0, 0]))
    body = chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + head + body)


@pytest.mark.parametrize(("size", "number"), [(2, errno.ENOSPC), (256, errno.EFBIG)])
def test_an_exr_that_the_disk_does_not_hold_whole_is_not_there(size, number, tmp_path):
    """Of small ones OpenEXR itself reports nothing: their bytes reach the disk when the file is closed."""
    code = (
        "import resource, numpy; from fit_material.renderer.images.image_file import write_exr;"
        f"pixels = numpy.random.default_rng(0).random(({size}, {size}, 3), numpy.float32);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300)); write_exr('out.exr', pixels)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    expected = f"expected a folder that can be written ({os.strerror(number)})"
    assert (
        done.stderr.splitlines()[-1]
        == f"fit_material.renderer.errors.input_error.InputError: out.exr: is ., {expected}"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("channels", [3, 4])
def test_written_exr_is_read_back_exactly(tmp_path, channels):
    pixels = np.random.default_rng(1).normal(size=(5, 7, channels)).astype(np.float32)
    write_exr(tmp_path / "a.exr", pixels)
    image = read_image(tmp_path / "a.exr")
    np.testing.assert_array_equal(image.radiance, pixels[..., :3])
    assert (image.alpha is None) == (channels == 3)
    if image.alpha is not None:
        np.testing.assert_array_equal(image.alpha, pixels[..., 3])
    assert image.white is None
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]


@pytest.mark.parametrize("name", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24"])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_of_any_lossless_compression_and_width(tmp_path, name, dtype):
    pixels = np.random.default_rng(2).random((20, 30, 3)).astype(dtype)
    compression = getattr(OpenEXR, f"{name}_COMPRESSION")
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": pixels}).write(str(tmp_path / "a.exr"))
    tolerance = 2.0**-15 if name == "PXR24" else 0  # PXR24 stores floats with 24 bits
    found = read_image(tmp_path / "a.exr").radiance
    np.testing.assert_allclose(found, pixels.astype(np.float32), rtol=tolerance)


def test_grey_exr_becomes_three_equal_channels(tmp_path):
    grey = np.random.default_rng(3).random((4, 6)).astype(np.float32)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": grey}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr").radiance, np.stack([grey] * 3, -1))


def test_exr_keeps_values_that_are_not_finite(tmp_path):
    pixels = np.ones((2, 2, 3), np.float32)
    pixels[0, 0, 0], pixels[1, 1, 2] = np.nan, np.inf
    write_exr(tmp_path / "a.exr", pixels)
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr").radiance, pixels)


def test_cropped_exr_is_refused(tmp_path):
    window = (np.array([1, 1], np.int32), np.array([4, 3], np.int32))
    header = {"type": OpenEXR.scanlineimage, "dataWindow": window}
    header["displayWindow"] = (np.array([0, 0], np.int32), np.array([9, 9], np.int32))
    OpenEXR.File(header, {"RGB": np.ones((3, 4, 3), np.float32)}).write(str(tmp_path / "a.exr"))
    with pytest.raises(InputError, match=r"a\.exr: dataWindow: .* expected the whole picture"):
        read_image(tmp_path / "a.exr")


def test_exr_without_colour_names_its_channels(tmp_path):
    depth = {"Z": np.ones((3, 4), np.float32)}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, depth).write(str(tmp_path / "a.exr"))
    with pytest.raises(InputError, match=r"a\.exr: channels: is Z, expected R G B or Y"):
        read_image(tmp_path / "a.exr")


def test_radiance_hdr_with_run_lengths(tmp_path):
    """A file put together by hand: mantissa m and exponent e stand for m/256 · 2^(e-128)."""
    width, runs = 16, (10, 20, 40, 130)
    row = bytes([2, 2, 0, width]) + b"".join(bytes([128 + width, value]) for value in runs)
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X {width}\n".encode()
    (tmp_path / "a.hdr").write_bytes(header + row * 2)
    expected = np.array([10, 20, 40]) / 256 * 4
    # Ward's own decoder adds half a unit to the mantissa and others do not
    found = read_image(tmp_path / "a.hdr").radiance
    np.testing.assert_allclose(found, np.broadcast_to(expected, (2, width, 3)), atol=0.5 / 256 * 4)


def test_real_hdr_holds_the_sun(shared_data):
    image = read_image(shared_data / "env" / "rooitou_park_1k.hdr")
    assert image.radiance.shape == (512, 1024, 3)
    assert np.isfinite(image.radiance).all()
    assert image.radiance.max() > 1000


@pytest.mark.parametrize("name", ["bridge", "esplanade", "studio"])
def test_real_exr_as_mitsuba_reads_it(shared_data, name):
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    path = shared_data / "env_exr_dwab" / f"{name}.exr"
    expected = np.array(mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32))
    # DWAB's decoder is not exact: versions of OpenEXR differ by some units in the last of a half's 11 bits
    np.testing.assert_allclose(read_image(path).radiance, expected, rtol=2.0**-8)


@pytest.mark.parametrize("shape", [(4, 6), (4, 6, 1), (4, 6, 3), (4, 6, 4)])
def test_npy_is_linear(tmp_path, shape):
    array = np.random.default_rng(4).normal(size=shape)
    np.save(tmp_path / "a.npy", array)
    colour = array.reshape(4, 6, -1)[..., :3].astype(np.float32)
    np.testing.assert_array_equal(read_image(tmp_path / "a.npy").radiance, np.broadcast_to(colour, (4, 6, 3)))


def test_doubles_beyond_float32_are_infinite(tmp_path):
    """Without a warning; who reads them leaves them out and counts them."""
    np.save(tmp_path / "a.npy", np.array([[1e300, -1e300, 1.0]]))
    np.testing.assert_array_equal(read_image(tmp_path / "a.npy").radiance[0, :, 0], [np.inf, -np.inf, 1])


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_sixteen_bits_stay_sixteen_bits(tmp_path, suffix):
    samples = codes((5, 6, 3), 16)
    path = tmp_path / f"a.{suffix}"
    write_png16(path, samples) if suffix == "png" else tifffile.imwrite(path, samples)
    expected = samples / 65535
    linear = read_image(path, "linear").radiance
    np.testing.assert_array_equal(np.rint(linear * 65535), samples)
    # the curve's slope is at most 2.3, so float32 leaves a few units of 2^-24
    np.testing.assert_allclose(read_image(path).radiance, decoded(expected), atol=1e-6)
    np.testing.assert_allclose(read_image(path, "gamma:2.2").radiance, expected**2.2, atol=1e-6)


@pytest.mark.parametrize("bits", [8, 16])
def test_pictures_with_more_samples_than_codes_are_decoded_alike(tmp_path, bits):
    """Every code there is, in a picture large enough for a table of them."""
    samples = np.arange(2**bits, dtype=f"uint{bits}").reshape(-1, 2 ** (bits // 2), 1).repeat(3, 2)
    samples[..., 1] = samples[::-1, :, 1]
    tifffile.imwrite(tmp_path / "a.tif", samples)
    expected = samples / (2**bits - 1)
    for encoding, curve in (("srgb", decoded), ("linear", lambda x: x), ("gamma:2.2", lambda x: x**2.2)):
        found = read_image(tmp_path / "a.tif", encoding).radiance
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, curve(expected), atol=1e-6)


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA"])
def test_eight_bit_modes_as_pillow_sees_them(tmp_path, mode, suffix):
    picture = PillowImage.fromarray(codes((5, 6, 3), 8)).convert(mode)
    picture.save(tmp_path / f"a.{suffix}")
    image = read_image(tmp_path / f"a.{suffix}")
    expected = decoded(np.asarray(picture.convert("RGB")) / 255)
    np.testing.assert_allclose(image.radiance, expected, atol=1e-6)
    assert (image.alpha is not None) == ("A" in mode)
    assert image.white == pytest.approx(decoded(np.array(253.5 / 255)), abs=1e-6)
    assert not image.lossy


def test_alpha_is_not_decoded_by_the_curve(tmp_path):
    samples = codes((5, 6, 4), 8)
    PillowImage.fromarray(samples).save(tmp_path / "a.png")
    alpha = read_image(tmp_path / "a.png").alpha
    assert alpha is not None
    np.testing.assert_allclose(alpha, samples[..., 3] / 255, atol=1e-7)


@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_jpeg_as_pillow_sees_it(tmp_path, mode):
    PillowImage.fromarray(codes((16, 16, 3), 8)).convert(mode).save(tmp_path / "a.jpg")
    expected = np.asarray(PillowImage.open(tmp_path / "a.jpg").convert("RGB")) / 255
    image = read_image(tmp_path / "a.jpg", "linear")
    np.testing.assert_array_equal(np.rint(image.radiance * 255), expected * 255)
    assert image.lossy
    assert image.white == pytest.approx(247.5 / 255)


def test_float_tiff_is_linear_and_planes_become_channels(tmp_path):
    pixels = np.random.default_rng(5).random((3, 8, 5)).astype(np.float32)
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="rgb", planarconfig="separate")
    image = read_image(tmp_path / "a.tif")
    np.testing.assert_array_equal(image.radiance, np.moveaxis(pixels, 0, -1))
    assert image.white is None


@pytest.mark.parametrize("suffix", ["exr", "hdr", "npy", "png", "jpg", "tif"])
def test_broken_files_are_one_sentence(tmp_path, suffix, capfd):
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(b"this is no image\nat all")
    with pytest.raises(InputError, match=rf"a\.{suffix}: expected a readable {suffix.upper()} image"):
        read_image(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("share", [0.02, 0.5, 0.95])
def test_truncated_exr_is_one_sentence(tmp_path, share, capfd):
    path = tmp_path / "a.exr"
    write_exr(path, np.random.default_rng(6).random((64, 64, 3)).astype(np.float32))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match=r"a\.exr: expected a readable EXR image; it is cut off, or no EXR"):
        read_image(path)
    assert capfd.readouterr() == ("", "")


def test_truncated_jpeg_is_refused(tmp_path):
    PillowImage.fromarray(codes((64, 64, 3), 8)).save(tmp_path / "a.jpg")
    data = (tmp_path / "a.jpg").read_bytes()
    (tmp_path / "a.jpg").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match="truncated"):
        read_image(tmp_path / "a.jpg")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("none.png", r"none\.png: expected an image file here, but there is none"),
        ("photo.heic", r"photo\.heic: format: is \.heic, expected one of \.exr \.hdr \.npy \.png"),
        ("noending", r"noending: format: is missing, expected one of"),
    ],
)
def test_missing_files_and_other_formats(tmp_path, name, sentence):
    with pytest.raises(InputError, match=sentence):
        read_image(tmp_path / name)


@pytest.mark.parametrize("encoding", ["sRGB", "gamma", "gamma:0", "gamma:-1", "gamma:0.0", "log"])
def test_unknown_encodings(tmp_path, encoding):
    np.save(tmp_path / "a.npy", np.ones((2, 2, 3)))
    with pytest.raises(InputError, match=rf'a\.npy: encoding: is .*{encoding}.*, expected "srgb"'):
        read_image(tmp_path / "a.npy", encoding)


@pytest.mark.parametrize("array", [np.ones((2, 2, 5)), np.ones(7), np.ones((0, 3, 3)), np.ones((2, 2), int)])
def test_arrays_that_are_no_pictures(tmp_path, array):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(InputError, match=r"a\.npy: (shape|dtype): is"):
        read_image(tmp_path / "a.npy")


def test_exr_into_what_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="folder that can be written"):
        write_exr(tmp_path / "file" / "a.exr", np.zeros((2, 2, 3), np.float32))
