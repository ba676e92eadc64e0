"""Camera raw: what was put into a file's photosites comes out as linear radiance."""

import numpy as np
import pytest
import tifffile

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.photographs.clipping import clipped_pixels

BLACK, WHITE = 512, 16383
NEUTRAL = (0.5, 1.0, 0.6667)  # the camera's answer to white
XYZ_TO_SRGB = (3.2405, -1.5371, -0.4985, -0.9693, 1.8760, 0.0416, 0.0556, -0.2040, 1.0572)
HEIGHT, WIDTH = 32, 48
STEP = 1 / (WHITE - BLACK)  # of a photosite's code; white balance multiplies it by 2 at most, and LibRaw rounds once


def rational(values) -> tuple[int, ...]:
    return tuple(part for value in values for part in (round(value * 10000), 10000))


def mosaic(radiance, height=HEIGHT, width=WIDTH) -> np.ndarray:
    """Codes of a sensor with an RGGB filter that sees a radiance [3] or [h, w, 3], in a camera whose primaries are
    Rec. 709's."""
    camera = np.broadcast_to(np.asarray(radiance) * NEUTRAL, (height, width, 3))
    row, column = np.mgrid[:height, :width]
    channel = row % 2 + column % 2
    seen = np.take_along_axis(camera, channel[..., None], 2)[..., 0]
    return np.rint(BLACK + np.clip(seen, 0, 1) * (WHITE - BLACK)).astype(np.uint16)


def write_dng(path, codes: np.ndarray, orientation=1, matrix=XYZ_TO_SRGB) -> None:
    """A DNG as its specification says (1.4, chapters 4 and 5), by a library that knows TIFF only."""
    camera = b"synthetic test camera\0"
    tags = [
        (274, "H", 1, orientation, True),
        (33421, "H", 2, (2, 2), True),  # CFARepeatPatternDim
        (33422, "B", 4, bytes([0, 1, 1, 2]), True),  # CFAPattern
        (33434, "2I", 1, (1, 60), True),  # ExposureTime
        (50706, "B", 4, bytes([1, 4, 0, 0]), True),  # DNGVersion
        (50707, "B", 4, bytes([1, 1, 0, 0]), True),  # DNGBackwardVersion
        (50708, "s", len(camera), camera, True),  # UniqueCameraModel
        (50714, "H", 1, BLACK, True),
        (50717, "I", 1, WHITE, True),
        (50721, "2i", 9, rational(matrix), True),  # ColorMatrix1
        (50728, "2I", 3, rational(NEUTRAL), True),  # AsShotNeutral
        (50778, "H", 1, 21, True),  # CalibrationIlluminant1: D65
    ]
    tifffile.imwrite(path, codes, photometric=32803, planarconfig=None, extratags=tags, metadata=None)


def read(tmp_path, codes, **options):
    write_dng(tmp_path / "a.dng", codes, **options)
    return read_image(tmp_path / "a.dng")


@pytest.mark.parametrize("radiance", [(0.18, 0.18, 0.18), (0.9, 0.1, 0.02), (0.001, 0.002, 0.003), (0, 0, 0)])
def test_an_even_field_is_its_radiance(tmp_path, radiance):
    """No curve, no brightening: black level and white balance alone."""
    image = read(tmp_path, mosaic(radiance))
    assert image.radiance.shape == (HEIGHT, WIDTH, 3)
    # rounded to a code, doubled by white balance, and cut to one of 65535 by LibRaw; its matrix is 1 to 10⁻⁴
    expected = np.broadcast_to(np.float32(radiance), image.radiance.shape)
    np.testing.assert_allclose(image.radiance, expected, rtol=1e-3, atol=2 * STEP)
    assert not clipped_pixels(image).any()


def test_twice_the_light_is_twice_the_radiance(tmp_path):
    dim, bright = (read(tmp_path, mosaic(value * np.ones(3))).radiance for value in (0.2, 0.4))
    np.testing.assert_allclose(bright, 2 * dim, atol=4 * STEP)


def test_a_camera_of_other_primaries(tmp_path):
    """Rows of the matrix from XYZ swapped are channels swapped."""
    rows = np.reshape(XYZ_TO_SRGB, (3, 3))
    radiance = read(tmp_path, mosaic((0.5, 0.25, 0.125)), matrix=tuple(rows[[2, 1, 0]].ravel())).radiance
    expected = np.broadcast_to(np.float32((0.125, 0.25, 0.5)), radiance.shape)
    np.testing.assert_allclose(radiance, expected, rtol=1e-3, atol=2 * STEP)


def test_full_photosites_are_clipped_with_what_is_mixed_from_them(tmp_path):
    codes = mosaic((0.2, 0.2, 0.2))
    codes[10, 20] = WHITE  # red
    clipped = clipped_pixels(read(tmp_path, codes)).numpy()
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[7:14, 17:24] = True
    np.testing.assert_array_equal(clipped, expected)


def test_pixels_beyond_those_marked_are_untouched_by_a_full_photosite(tmp_path):
    codes = mosaic((0.2, 0.2, 0.2))
    even = read(tmp_path, codes).radiance
    codes[10, 20] = WHITE
    image = read(tmp_path, codes)
    free = ~clipped_pixels(image).numpy()
    np.testing.assert_array_equal(image.radiance[free], even[free])


@pytest.mark.parametrize(("orientation", "turns"), [(1, 0), (3, 2), (6, -1), (8, 1)])
def test_a_camera_held_upright(tmp_path, orientation, turns):
    """Radiance and clipped pixels are turned alike: one corner is bright, and in it a photosite is full."""
    codes = mosaic((0.1, 0.1, 0.1))
    codes[:8, :12] = mosaic((0.4, 0.4, 0.4))[:8, :12]
    codes[2, 4] = WHITE
    image = read(tmp_path, codes, orientation=orientation)
    bright = np.zeros((HEIGHT, WIDTH), bool)
    bright[:8, :12] = True
    assert image.radiance.shape[:2] == np.rot90(bright, turns).shape
    np.testing.assert_array_equal(image.radiance[..., 1] > 0.25, np.rot90(bright, turns))
    assert image.full is not None
    assert [tuple(place) for place in np.argwhere(np.rot90(image.full, -turns))] == [(2, 4)]


def test_the_real_ramp_is_straight(shared_data):
    """Its truth, as its photosites have it: red rises to the right, blue downwards, green is 0.18."""
    image = read_image(shared_data / "raw" / "synthetic_ramp.dng")
    height, width = image.radiance.shape[:2]
    row, column = np.mgrid[:height, :width]
    truth = np.stack([column / (width - 1), np.full((height, width), 0.18), row / (height - 1)], -1)
    inside = (slice(4, -4), slice(4, -4))
    kept = ~clipped_pixels(image).numpy()[inside]
    # demosaicing guides red and blue by green, which is flat: ramps stay straight to a code or two
    np.testing.assert_allclose(image.radiance[inside][kept], truth[inside][kept], atol=1e-3)
    assert kept.mean() > 0.95


@pytest.mark.parametrize("encoding", ["srgb", "gamma:2.2"])
def test_raw_has_no_curve_to_undo(tmp_path, encoding):
    write_dng(tmp_path / "a.dng", mosaic((0.2, 0.2, 0.2)))
    assert read_image(tmp_path / "a.dng", "linear").radiance.shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(InputError, match=rf"a\.dng: encoding: is '{encoding}', expected \"linear\" or none"):
        read_image(tmp_path / "a.dng", encoding)


@pytest.mark.parametrize("suffix", ["dng", "nef", "cr2"])
def test_broken_raw_is_one_sentence(tmp_path, suffix, capfd):
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(b"this is no image\nat all")
    with pytest.raises(InputError, match=rf"a\.{suffix}: expected a readable {suffix.upper()} image"):
        read_image(path)
    assert capfd.readouterr() == ("", "")
