"""Exposures: what EXIF says, which way up a picture is, and several exposures of one view as one radiance map."""

import json
import logging
import shutil
from fractions import Fraction

import numpy as np
import pytest
import tifffile
import torch
from PIL import Image as PillowImage
from PIL import ImageOps
from PIL.TiffImagePlugin import IFDRational

from fit_material.fitter.observations.photograph import read_photograph
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.validation import check
from fit_material.renderer.images.exif import read_exif, relative_exposure
from fit_material.renderer.images.image_file import read_image, write_exr
from fit_material.renderer.photographs.exposure import expose
from fit_material.renderer.scene.scene_file import PhotographSpec
from tests.renderer.images.test_camera_raw import mosaic, write_dng
from tests.support.srgb_curve import encoded

CAMERA = {"origin": [0, 0, 4], "target": [0, 0, 0]}
SECONDS, APERTURE, ISO, ORIENTATION, EXIF_TABLE = 0x829A, 0x829D, 0x8827, 0x0112, 0x8769


def exif(seconds=None, aperture=None, iso=None, orientation=None) -> PillowImage.Exif:
    entries = PillowImage.Exif()
    if orientation is not None:
        entries[ORIENTATION] = orientation
    parts = {SECONDS: _rational(seconds), APERTURE: _rational(aperture), ISO: iso}
    entries[EXIF_TABLE] = {tag: value for tag, value in parts.items() if value is not None}
    return entries


def _rational(value: float | None) -> IFDRational | None:
    return None if value is None else IFDRational(Fraction(value).limit_denominator(10000))


def spec(tmp_path, **table) -> PhotographSpec:
    return check(PhotographSpec, {"camera": CAMERA, **table}, tmp_path / "scene.toml")


def srgb_codes(linear: np.ndarray) -> np.ndarray:
    """Codes of 8 bits."""
    return np.rint(255 * encoded(np.clip(linear, 0, 1))).astype(np.uint8)


@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_exif_is_what_pillow_wrote(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    PillowImage.new("RGB", (4, 3)).save(path, exif=exif(1 / 250, 5.6, 400, 6))
    found = read_exif(path)
    assert found.orientation == 6
    assert (found.seconds, found.aperture, found.iso) == (pytest.approx(0.004), pytest.approx(5.6), 400)
    assert relative_exposure(path) == pytest.approx(0.004 * 4 / 5.6**2)


def test_exif_of_camera_raw(tmp_path):
    write_dng(tmp_path / "a.dng", mosaic((0.2, 0.2, 0.2)))
    assert relative_exposure(tmp_path / "a.dng") == pytest.approx(1 / 60)  # neither aperture nor sensitivity in it


@pytest.mark.parametrize("data", [b"", b"no picture", b"\xff\xd8\xff\xe1\xff\xffExif\0\0MM\0*" + b"\xff" * 40])
def test_files_without_exif_say_nothing(tmp_path, data, caplog, capfd):
    path = tmp_path / "a.jpg"
    path.write_bytes(data)
    with caplog.at_level(logging.DEBUG):
        assert read_exif(path).seconds is None
    assert capfd.readouterr() == ("", "")
    with pytest.raises(
        InputError, match=r"a\.jpg: ExposureTime: expected it in the file's EXIF, or the exposure given"
    ):
        relative_exposure(path)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_pictures_are_turned_as_pillow_turns_them(tmp_path, suffix, orientation):
    samples = np.random.default_rng(0).integers(0, 256, (5, 7, 4), dtype=np.uint8)
    PillowImage.fromarray(samples).save(tmp_path / "a.png", exif=exif(orientation=orientation))
    expected = np.asarray(ImageOps.exif_transpose(PillowImage.open(tmp_path / "a.png")))
    tags = [(ORIENTATION, "H", 1, orientation, True)]
    tifffile.imwrite(tmp_path / "a.tif", samples, extratags=tags, photometric="rgb", extrasamples=["unassalpha"])
    image = read_image(tmp_path / f"a.{suffix}", "linear")
    np.testing.assert_array_equal(np.rint(255 * image.radiance), expected[..., :3])
    np.testing.assert_array_equal(np.rint(255 * np.asarray(image.alpha)), expected[..., 3])


def test_a_mask_is_turned_by_its_own_tag_only(tmp_path):
    PillowImage.new("RGB", (6, 4), (99, 99, 99)).save(tmp_path / "a.jpg", exif=exif(orientation=6))
    PillowImage.new("L", (4, 6), 255).save(tmp_path / "mask.png")
    photograph = read_photograph(spec(tmp_path, image="a.jpg", mask="mask.png"), "scene.toml")
    assert photograph.radiance.shape == (6, 4, 3)
    assert (photograph.camera.width, photograph.camera.height) == (4, 6)


def test_exposure_by_exif(tmp_path):
    path = tmp_path / "a.png"
    PillowImage.new("RGB", (4, 3), (128,) * 3).save(path, exif=exif(1 / 30, 8, 200))
    photograph = read_photograph(spec(tmp_path, image="a.png", encoding="linear", exposure="exif"), "scene.toml")
    factor = 1 / 30 * 2 / 64
    assert photograph.exposure == pytest.approx(factor)
    torch.testing.assert_close(photograph.radiance, torch.full((3, 4, 3), 128 / 255 / factor))


@pytest.fixture
def bracket(tmp_path):
    """Writes photographs of one radiance [h, w, 3] at several exposure times, with EXIF; returns their names."""

    def write(radiance, times, noise=0.0):
        random, names = np.random.default_rng(1), []
        for i, time in enumerate(times):
            pixels = radiance * time
            pixels = pixels + noise * np.sqrt(pixels) * random.normal(size=radiance.shape)
            names.append(f"e{i}.png")
            PillowImage.fromarray(srgb_codes(pixels)).save(tmp_path / names[-1], exif=exif(time))
        return names

    return write


TIMES = (1 / 64, 1 / 8, 1)
RADIANCE = np.exp(np.linspace(np.log(0.02), np.log(40), 64 * 64)).reshape(64, 64, 1) * np.array([1, 0.8, 0.6])


@pytest.mark.parametrize("exposure", ["exif", None, list(TIMES)])
def test_three_exposures_are_one_radiance_map(tmp_path, bracket, exposure):
    given = {} if exposure is None else {"exposure": exposure}
    seen = expose(spec(tmp_path, images=bracket(RADIANCE, TIMES), **given))
    assert not seen.clipped.any()  # the brightest is 40/64 in the shortest
    assert seen.exposure == 1
    # half a code of sRGB is at most 2.8 % of the darkest, 0.012, in the longest exposure; in the two others it is as
    # much again as 1.1 % each, for there a code is 3·10⁻⁴ and their pixels are added
    np.testing.assert_allclose(seen.radiance.numpy(), RADIANCE, rtol=0.05)


def test_merging_beats_every_single_exposure(tmp_path, bracket):
    """Noise of the light's own kind: the merged map's variance is that of all the light together, 1/Σt."""
    flat = np.full((64, 64, 3), 0.4)
    times = (0.5, 0.75, 1.0)
    names = bracket(flat, times, noise=0.05)
    merged = expose(spec(tmp_path, images=names)).radiance.numpy()
    expected = 0.05 * np.sqrt(0.4 / sum(times))
    count = merged.size
    # the standard deviation of n samples is known to 1/√(2n); rounding to codes adds 0.6 % of these to it
    assert merged.std() == pytest.approx(expected, rel=0.01 + 3 / np.sqrt(2 * count))
    assert abs(merged.mean() - 0.4) < 4 * expected / np.sqrt(count) + 1e-4


@pytest.mark.parametrize("exposure", [0.5, [0.5]])
def test_one_exposure_in_a_list_is_one_photograph(tmp_path, bracket, exposure):
    (name,) = bracket(np.full((4, 4, 3), 0.6), [0.5])
    seen = expose(spec(tmp_path, images=[name], exposure=exposure))
    np.testing.assert_allclose(seen.radiance.numpy(), 0.6, rtol=0.01)  # half a code of sRGB there is 0.5 %


def test_what_every_exposure_clips_is_clipped(tmp_path, bracket):
    bright = np.full((9, 9, 3), 0.3)
    bright[4, 4] = 1000
    photograph = read_photograph(spec(tmp_path, images=bracket(bright, (0.1, 1))), "scene.toml")
    expected = torch.ones(9, 9, dtype=torch.bool)
    expected[3:6, 3:6] = False
    assert torch.equal(photograph.mask, expected)
    assert photograph.clipped == 9
    assert len(photograph.inputs) == 2


def test_floats_merge_where_one_is_not_finite(tmp_path):
    for i, value in enumerate((1.0, 2.0)):
        pixels = np.full((3, 4, 3), value, np.float32)
        pixels[i, 0] = np.nan
        write_exr(tmp_path / f"{i}.exr", pixels)
    seen = expose(spec(tmp_path, images=["0.exr", "1.exr"], exposure=[1.0, 2.0]))
    assert seen.finite.all()
    torch.testing.assert_close(seen.radiance, torch.ones(3, 4, 3))


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"images": ["a.png"], "image": "a.png"}, r"images: expected either image, or images with at least one"),
        ({"images": []}, "images: expected either image, or images with at least one"),
        (
            {"images": ["a.png", "a.png"], "exposure": 1.0},
            r'exposure: is 1\.0, expected a list of 2 numbers, or "exif"',
        ),
        (
            {"images": ["a.png", "a.png"], "exposure": [1.0]},
            r'exposure: is .*, expected a list of 2 numbers, or "exif"',
        ),
        ({"images": ["a.png", "a.png"], "exposure": "fit"}, r'exposure: is "fit", expected a list of 2 numbers'),
        ({"image": "a.png", "encoding": "fit"}, r'encoding: is "fit", expected images of several exposures beside it'),
        ({"image": "a.png", "exposure": [1.0, 2.0]}, r"exposure: is .*, expected one number, or images with as many"),
        ({"images": ["a.png", "b.png"]}, r"images\[1\]: is .*b\.png, expected a file or folder that exists"),
        ({"images": "a.png"}, "images: is .*a.png.*, expected a list"),
    ],
)
def test_slips_about_exposures_are_one_sentence(tmp_path, table, sentence):
    PillowImage.new("RGB", (4, 3)).save(tmp_path / "a.png")
    with pytest.raises(InputError, match=sentence):
        spec(tmp_path, **table)


@pytest.mark.parametrize("said", [TIMES[::-1], (1 / 64, 1 / 8, 2.0), (1 / 64, 1 / 64, 1 / 64)])
def test_exposures_that_their_pixels_contradict(tmp_path, bracket, said):
    """Lists in the wrong order, a slip in one number, and the times left out."""
    names = bracket(RADIANCE, TIMES)
    with pytest.raises(
        InputError, match=r"e\d\.png: exposure: is [\d.]+, expected about [\d.]+ times that of e\d\.png"
    ):
        expose(spec(tmp_path, images=names, exposure=list(said)))


@pytest.mark.parametrize("off", [1.3, 1 / 1.3])
def test_exposures_that_are_a_little_off_are_merged(tmp_path, bracket, off):
    """Shutters and lamps are so."""
    said = [TIMES[0], off * TIMES[1], TIMES[2]]
    assert expose(spec(tmp_path, images=bracket(RADIANCE, TIMES), exposure=said)).finite.all()


def test_exposures_that_share_no_pixel_are_merged(tmp_path):
    """A dark picture and a white one; there is nothing to compare."""
    for name, code in (("a.png", 1), ("b.png", 255)):
        PillowImage.new("RGB", (64, 64), (code,) * 3).save(tmp_path / name)
    assert expose(spec(tmp_path, images=["a.png", "b.png"], exposure=[1.0, 1000.0])).finite.all()


def test_exposures_of_unlike_size(tmp_path):
    for name, size in (("a.png", (4, 3)), ("b.png", (3, 4))):
        PillowImage.new("RGB", size, (9, 9, 9)).save(tmp_path / name)
    with pytest.raises(InputError, match=r"b\.png: size: is 3 × 4 pixels, expected 4 × 3 pixels, as the first"):
        expose(spec(tmp_path, images=["a.png", "b.png"], exposure=[1.0, 2.0]))


@pytest.mark.slow
def test_a_metal_by_three_jpeg_exposures(gold_photographs, tmp_path):
    """Path-traced gold as a camera would have it: 8 bits, sRGB, shot noise of 1 % at white, the brightest clipped."""
    from fit_material.fitter.options.fidelity import PRESETS
    from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene

    folder = tmp_path / "scene"
    shutil.copytree(gold_photographs, folder)
    text, times, random = (folder / "scene.toml").read_text(), (1 / 16, 1 / 4, 1.0), np.random.default_rng(0)
    for view in range(2):
        image = read_image(folder / f"view_{view}.exr")
        for i, time in enumerate(times):
            pixels = image.radiance * time
            pixels = pixels + 0.01 * np.sqrt(pixels) * random.normal(size=pixels.shape)
            codes = PillowImage.fromarray(srgb_codes(pixels))
            codes.save(folder / f"{view}_{i}.jpg", exif=exif(time), quality=98, subsampling=0)
        PillowImage.fromarray((255 * (np.asarray(image.alpha) > 0.999)).astype(np.uint8)).save(folder / f"{view}.png")
        names = json.dumps([f"{view}_{i}.jpg" for i in range(3)])
        text = text.replace(f'image = "view_{view}.exr"\nexposure = 1.0', f'images = {names}\nmask = "{view}.png"')
    (folder / "scene.toml").write_text(text)
    found = fit_scene(folder / "scene.toml", tmp_path / "fit", FitOptions(PRESETS["preview"], type="metal"))
    truth = json.loads((folder / "truth.json").read_text())["materials"][0]["f0"]
    np.testing.assert_allclose(found.materials[0].f0, truth, atol=0.01)  # the figure that was asked for
