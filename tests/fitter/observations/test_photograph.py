"""Which pixels of a photograph are trusted, and what radiance they stand for."""

import math

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from PIL import Image as PillowImage
from scipy.ndimage import maximum_filter

from fit_material.fitter.observations.photograph import read_photograph
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.photographs.clipping import dilated
from fit_material.renderer.scene.lens_spec import LensSpec
from fit_material.renderer.scene.scene_file import CameraSpec, PhotographSpec

CAMERA = CameraSpec(origin=(0, 0, 4), target=(0, 0, 0))
HEIGHT, WIDTH = 6, 8


@pytest.fixture
def spec(tmp_path):
    """Writes pixels [h, w, c], 8-bit codes as PNG or JPEG and others as EXR, and a mask, as a photograph's table."""

    def write(pixels, mask=None, ending=".png", **options):
        pixels = np.asarray(pixels)
        path = tmp_path / (f"view{ending}" if pixels.dtype == np.uint8 else "view.exr")
        if pixels.dtype == np.uint8:
            PillowImage.fromarray(pixels).save(path)
        else:
            write_exr(path, pixels)
        if mask is not None:
            options["mask"] = tmp_path / "mask.png"
            PillowImage.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(options["mask"])
        return PhotographSpec(image=path, camera=CAMERA, **options)

    return write


def ones(channels: int = 3) -> np.ndarray:
    return np.ones((HEIGHT, WIDTH, channels), np.float32)


@pytest.mark.parametrize(("exposure", "factor"), [(1.0, 1), (0.25, 4), (2, 0.5), ("fit", 1)])
def test_radiance_is_pixel_over_exposure(spec, exposure, factor):
    photograph = read_photograph(spec(0.75 * ones(), exposure=exposure), "scene.toml")
    assert photograph.name == "view"
    assert photograph.exposure == (None if exposure == "fit" else exposure)
    assert photograph.mask.all()
    assert (photograph.camera.width, photograph.camera.height) == (WIDTH, HEIGHT)
    torch.testing.assert_close(photograph.radiance, torch.full((HEIGHT, WIDTH, 3), 0.75 * factor))


def test_only_fully_covered_pixels_count(spec):
    pixels = ones(4)
    pixels[0, :, 3] = [0, 0.5, 0.99, 0.998, 0.9995, 1, 1.0004, 1]
    mask = read_photograph(spec(pixels), "scene.toml").mask
    assert mask[0].tolist() == [False] * 4 + [True] * 4
    assert mask[1:].all()


def test_mask_loses_its_border_but_not_the_picture_s(spec):
    white = np.zeros((HEIGHT, WIDTH), bool)
    white[0:4, 2:7] = True
    mask = read_photograph(spec(ones(), white), "scene.toml").mask
    expected = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    expected[0:3, 3:6] = True  # the upper side lies on the picture's own border, where nothing was cut
    assert torch.equal(mask, expected)


def test_mask_and_alpha_must_both_agree(spec):
    pixels = ones(4)
    pixels[:, :5, 3] = 0
    white = np.zeros((HEIGHT, WIDTH), bool)
    white[:, :7] = True
    mask = read_photograph(spec(pixels, white), "scene.toml").mask
    assert torch.equal(mask.any(0), torch.arange(WIDTH) == 5)


def test_broken_pixels_are_left_out_and_counted_inside_the_mask(spec):
    pixels = ones(4)
    pixels[0, 0, 3] = 0
    pixels[0, 0, 0] = math.nan
    pixels[2, 3, 1] = math.inf
    pixels[4, 4] = math.nan, math.nan, math.nan, 1
    photograph = read_photograph(spec(pixels), "scene.toml")
    assert photograph.nonfinite == 2
    assert photograph.clipped == 0
    assert int(photograph.mask.sum()) == HEIGHT * WIDTH - 3
    assert photograph.radiance.isfinite().all()


@pytest.mark.parametrize("encoding", ["srgb", "linear", "gamma:2.2"])
def test_clipped_pixels_of_integer_files_are_left_out_with_their_neighbours(spec, encoding):
    pixels = np.full((HEIGHT, WIDTH, 3), 253, np.uint8)
    pixels[2, 3, 2] = 254
    photograph = read_photograph(spec(pixels, encoding=encoding), "scene.toml")
    expected = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    expected[1:4, 2:5] = False
    assert torch.equal(photograph.mask, expected)
    assert photograph.clipped == 9


def test_a_clipped_pixel_of_a_jpeg_takes_its_block_along(spec):
    pixels = np.full((48, 64, 3), 120, np.uint8)
    pixels[16:24, 24:32] = 255
    photograph = read_photograph(spec(pixels, ending=".jpg"), "scene.toml")
    expected = torch.ones(48, 64, dtype=torch.bool)
    expected[8:32, 16:40] = False
    assert torch.equal(photograph.mask, expected)
    assert photograph.clipped == 24 * 24


def test_floats_above_one_are_not_clipped(spec):
    assert read_photograph(spec(100 * ones()), "scene.toml").mask.all()


def test_mask_of_another_size_names_both(spec):
    white = np.ones((HEIGHT + 1, WIDTH), bool)
    sentence = r"scene\.toml: photographs\[2\]\.mask: is mask\.png with 8 × 7 pixels, expected .* 8 × 6 pixels"
    with pytest.raises(InputError, match=sentence):
        read_photograph(spec(ones(), white), "scene.toml", 2)


@pytest.mark.parametrize(("width", "height", "fits"), [(800, 600, True), (400, 299, True), (600, 800, False)])
def test_a_lens_measured_on_pictures_of_other_proportions_is_refused(spec, width, height, fits):
    lens = LensSpec(width=width, height=height, fx=700.0, k1=0.01)
    table = spec(ones()).model_copy(update={"camera": CAMERA.model_copy(update={"lens": lens, "fov": None})})
    if fits:
        assert read_photograph(table, "scene.toml").camera.width == WIDTH
        return
    told = (
        rf"scene\.toml: photographs\[0\]\.camera\.lens: is for 600 × 800 pixels, .* photograph, {WIDTH} × {HEIGHT}: was"
    )
    with pytest.raises(InputError, match=told):
        read_photograph(table, "scene.toml")


@pytest.mark.parametrize("thickness", [0, 1, 2])
def test_empty_mask(spec, thickness):
    white = np.zeros((HEIGHT, WIDTH), bool)
    white[2 : 2 + thickness] = True
    sentence = r"scene\.toml: photographs\[0\]\.mask: is mask\.png, expected white pixels .* 3 × 3 at least"
    with pytest.raises(InputError, match=sentence):
        read_photograph(spec(ones(), white), "scene.toml")


def test_empty_alpha(spec):
    with pytest.raises(InputError, match=r"photographs\[1\]\.image: is view\.exr, expected an alpha channel"):
        read_photograph(spec(0 * ones(4)), "scene.toml", 1)


def test_nothing_but_clipped_pixels(spec):
    white = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    with pytest.raises(
        InputError,
        match=r"photographs\[0\]\.image: is view\.png, clipped throughout, expected at least one .* not clipped",
    ):
        read_photograph(spec(white), "scene.toml")


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (0, "black inside the mask, expected light on the object"),
        (-1, "black inside the mask, expected light on the object"),
        (1e-25, "with a radiance of 1e-25 at the brightest, expected light on the object of 1e-20 to 1e.20"),
        (1e25, "with a radiance of 1e.25 at the brightest, expected light on the object of 1e-20 to 1e.20"),
        (math.nan, "NaN or infinite throughout, expected numbers inside the mask; export"),
    ],
)
def test_photographs_without_light_to_fit(spec, value, sentence):
    pixels = ones()
    pixels[1:5, 1:7] = value  # what shines outside of the mask is no light on the object
    white = np.zeros((HEIGHT, WIDTH), bool)
    white[1:5, 1:7] = True
    with pytest.raises(InputError, match=rf"photographs\[1\]\.image: is view\.exr,? {sentence}"):
        read_photograph(spec(pixels, white), "scene.toml", 1)


def test_unreadable_image(spec):
    table = spec(ones())
    table.image.write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"view\.exr: expected a readable EXR image"):
        read_photograph(table, "scene.toml")


@settings(max_examples=60)
@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=24), elements=st.booleans()), st.integers(0, 9))
@example(np.array([[True, False, False]]), 4)
def test_masks_grow_as_scipys_do(mask, reach):
    expected = maximum_filter(mask, 2 * reach + 1, mode="constant")
    assert torch.equal(dilated(torch.from_numpy(mask), reach), torch.from_numpy(expected))
