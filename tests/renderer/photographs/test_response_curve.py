"""Response curves: a camera whose curve is known, and OpenCV's fit of the same."""

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.photographs.exposure import expose
from fit_material.renderer.photographs.response_curve import fitted_response
from tests.renderer.photographs.test_exposure import spec, srgb_codes

TIMES = (1 / 32, 1 / 8, 1 / 2, 2)
GAMMAS = np.array([1.6, 2.2, 2.8])
SRGB = ((np.arange(256) / 255 + 0.055) / 1.055) ** 2.4  # IEC 61966-2-1 above code 10
RADIANCE = np.exp(np.random.default_rng(2).uniform(np.log(0.01), np.log(20), (60, 80, 3)))


def codes_of(radiance: np.ndarray, time: float) -> np.ndarray:
    """8 bits by a power of its own for each channel."""
    return np.rint(255 * np.clip(radiance * time, 0, 1) ** (1 / GAMMAS)).astype(np.uint8)


def exposures() -> list[np.ndarray]:
    return [codes_of(RADIANCE, time) for time in TIMES]


def curve() -> np.ndarray:
    stack = np.stack(exposures(), -2).reshape(-1, len(TIMES), 3).astype(int)
    return fitted_response(stack[:2000], TIMES, SRGB, "a.png")  # type: ignore[arg-type]


def test_a_known_curve_is_found():
    middle = slice(40, 240)
    z = np.arange(256)[middle, None] / 255
    truth = z**GAMMAS / (128 / 255) ** GAMMAS * SRGB[128]
    # half a code is γ/2z of a curve's value, 3.5 % at code 40, over some dozen pixels at each: 1 % is left
    np.testing.assert_allclose(curve()[middle], truth, rtol=0.02)


def test_opencv_finds_the_same_curve():
    pictures = [picture[..., ::-1].copy() for picture in exposures()]  # blue first
    calibrated = cv2.createCalibrateDebevec(300, 30.0, True).process(pictures, np.float32(TIMES))[:, 0, ::-1]
    middle = slice(40, 240)
    expected = calibrated[middle] / calibrated[128] * SRGB[128]
    np.testing.assert_allclose(curve()[middle], expected, rtol=0.03)  # by other pixels: 2 % each, as above


def test_the_curve_rises():
    found = curve()
    assert (found > 0).all()
    assert (np.diff(found, axis=0) >= 0).all()


def test_photographs_by_a_fitted_curve_are_radiance_but_for_a_factor(tmp_path):
    smooth = np.exp(np.linspace(np.log(0.02), np.log(8), 60 * 80)).reshape(60, 80, 1) * np.array([1, 0.8, 0.6])
    names = [f"{i}.png" for i in range(len(TIMES))]
    for name, time in zip(names, TIMES, strict=True):
        PillowImage.fromarray(codes_of(smooth, time)).save(tmp_path / name)
    seen = expose(spec(tmp_path, images=names, exposure=list(TIMES), encoding="fit"))
    usable = ~seen.clipped.numpy()
    ratio = (seen.radiance.numpy() / smooth)[usable]
    # each channel keeps a factor of its own, where its curve crosses sRGB's
    expected = SRGB[128] / (128 / 255) ** GAMMAS
    np.testing.assert_allclose(ratio, np.broadcast_to(expected, ratio.shape), rtol=0.06)
    assert usable.mean() > 0.9


def test_an_srgb_camera_needs_no_factor(tmp_path):
    names = [f"{i}.png" for i in range(len(TIMES))]
    smooth = np.exp(np.linspace(np.log(0.02), np.log(8), 60 * 80)).reshape(60, 80, 1) * np.ones(3)
    for name, time in zip(names, TIMES, strict=True):
        PillowImage.fromarray(srgb_codes(smooth * time)).save(tmp_path / name)
    given, found = (
        expose(spec(tmp_path, images=names, exposure=list(TIMES), encoding=encoding)) for encoding in ("srgb", "fit")
    )
    usable = ~found.clipped.numpy()
    np.testing.assert_allclose(found.radiance.numpy()[usable], given.radiance.numpy()[usable], rtol=0.05)


@pytest.mark.parametrize(
    ("times", "values", "sentence"),
    [
        ([1.0, 1.0], (20, 90), r'0\.png: encoding: is "fit", expected images of different exposures, or a curve'),
        ([1.0, 2.0], (90, 90), r'0\.png: encoding: is "fit", expected images whose pixels differ from exposure to'),
    ],
)
def test_exposures_that_tell_no_curve(tmp_path, times, values, sentence):
    for i, value in enumerate(values):
        PillowImage.new("RGB", (40, 30), (value,) * 3).save(tmp_path / f"{i}.png")
    with pytest.raises(InputError, match=sentence):
        expose(spec(tmp_path, images=["0.png", "1.png"], exposure=times, encoding="fit"))


def test_floats_have_no_curve(tmp_path):
    np.save(tmp_path / "a.npy", np.ones((3, 4, 3)))
    with pytest.raises(InputError, match=r'a\.npy: encoding: is "fit", expected "linear": files of floats'):
        expose(spec(tmp_path, images=["a.npy", "a.npy"], exposure=[1.0, 2.0], encoding="fit"))
