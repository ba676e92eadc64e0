import math

import numpy as np
import pytest

from fit_material.fitter.report.image_quality import ViewPictures, assess, compare
from fit_material.renderer.images.display import tone_mapped, white_point


def picture(value, height=12, width=10):
    return np.full((height, width, 3), value, dtype=np.float32)


def everywhere(like):
    return np.ones(like.shape[:2], dtype=bool)


def test_a_constant_excess_has_closed_forms():
    photograph, fit = picture(2.0), picture(1.8)
    quality = compare(photograph, fit, everywhere(fit))
    assert quality.rms_relative == pytest.approx(0.1, rel=1e-6)
    encoded = 1.055 * 0.9 ** (1 / 2.4) - 0.055  # the photograph is white: 1
    assert quality.psnr == pytest.approx(-20 * math.log10(1 - encoded), rel=1e-5)
    c1 = 0.01**2  # Wang 2004, eq. 13: without variance only the luminance term is left
    assert quality.ssim == pytest.approx((2 * encoded + c1) / (1 + encoded**2 + c1), rel=1e-5)


def test_outside_of_the_mask_nothing_counts():
    rng = np.random.default_rng(0)
    photograph, fit = rng.random((2, 20, 20, 3)).astype(np.float32)
    mask = np.zeros((20, 20), dtype=bool)
    mask[4:14, 5:17] = True
    mask[4, 5] = False
    expected = compare(photograph, fit, mask)
    photograph[~mask], fit[~mask] = 7.0, np.nan
    assert compare(photograph, fit, mask) == expected


def test_equal_pictures():
    photograph = np.random.default_rng(0).random((9, 9, 3)).astype(np.float32)
    quality = compare(photograph, photograph, everywhere(photograph))
    assert quality.rms_relative == 0
    assert quality.psnr is None  # infinite, which JSON cannot say
    assert quality.ssim == pytest.approx(1)


def test_what_cannot_be_computed_is_none():
    photograph = picture(1.0)
    nothing = compare(photograph, photograph, np.zeros((12, 10), dtype=bool))
    black = compare(0 * photograph, photograph, everywhere(photograph))
    assert nothing == black
    assert (nothing.rms_relative, nothing.psnr, nothing.ssim) == (None, None, None)
    narrow = compare(picture(1.0, width=6), picture(0.9, width=6), everywhere(picture(1.0, width=6)))
    assert narrow.ssim is None
    assert narrow.psnr is not None


def test_overall_is_the_mean_of_what_exists():
    one, two = picture(1.0), picture(2.0)
    views = [
        ViewPictures("a", one, 0.9 * one, everywhere(one)),
        ViewPictures("b", two, 0.7 * two, everywhere(two)),
        ViewPictures("c", one, one, np.zeros((12, 10), dtype=bool)),
    ]
    quality = assess(views)
    assert [each.name for each in quality.photographs] == ["a", "b", "c"]
    assert quality.overall.rms_relative == pytest.approx(0.2, rel=1e-6)
    assert assess([]).overall.psnr is None


def test_tone_curve_is_srgb():
    # IEC 61966-2-1: linear 0.2140 is code value 127.5
    assert tone_mapped(np.array([0.0, 0.21404114, 1.0, 5.0, -1.0]), 1.0) == pytest.approx([0, 0.5, 1, 1, 0])
    assert tone_mapped(np.array([0.0031308]), 1.0) == pytest.approx(0.04045, abs=1e-5)


def test_white_point():
    assert white_point(np.arange(1001.0)) == pytest.approx(999)
    assert white_point(np.zeros(3)) == white_point(np.zeros(0)) == 1.0
