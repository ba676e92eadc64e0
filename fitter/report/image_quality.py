"""How alike a photograph and its fit are, in three numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from fit_material.fitter.result.schema import PhotographQuality, PictureQuality, Quality
from fit_material.renderer.images.display import tone_mapped, white_point

SSIM_WINDOW = 7  # pixels; skimage's default, Wang 2004's with equal weights


@dataclass(frozen=True)
class ViewPictures:
    """One photograph and its fit, in the photograph's own exposure.

    Attributes:
        name: of the photograph's file; unique.
        photograph: linear Rec. 709, float32 [h, w, 3].
        fit: the same, of the fitted material; only read where `mask` is.
        mask: the pixels that were compared, [h, w].
    """

    name: str
    photograph: Float[np.ndarray, "h w 3"]
    fit: Float[np.ndarray, "h w 3"]
    mask: Bool[np.ndarray, "h w"]


def compare(
    photograph: Float[np.ndarray, "h w 3"],
    fit: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
) -> PictureQuality:
    """Quality of one fit, over the masked pixels and their three channels.

        rms_relative = √(mean (fit - photograph)² / mean photograph²)
        psnr         = 10 log₁₀ (1 / mean (t(fit) - t(photograph))²)
        ssim         = mean of Wang 2004's index of t(fit), t(photograph), all channels, 7 × 7 pixels

    t is `tone_mapped` with the photograph's `white_point`; its range is [0, 1]. Around the mask both
    pictures are taken to be black.

    Returns:
        None for what cannot be computed: all three if no pixel is masked or the photograph is black there,
        psnr if the tone-mapped pictures are equal, ssim if the mask's bounding box is less than 7 pixels high
        or wide.
    """
    from skimage.metrics import structural_similarity

    if not photograph[mask].any():
        return PictureQuality(rms_relative=None, psnr=None, ssim=None)
    difference = fit[mask].astype(np.float64) - photograph[mask]
    white = white_point(photograph[mask])
    a, b = (_box(tone_mapped(np.where(mask[..., None], x, 0), white), mask) for x in (photograph, fit))
    inside = _box(mask, mask)
    psnr = ssim = None
    if not np.array_equal(a[inside], b[inside]):
        # skimage's own loads all of scipy.stats, which takes as long as the comparison of ten photographs
        psnr = float(-10 * np.log10(np.mean((a[inside].astype(np.float64) - b[inside]) ** 2)))
    if min(inside.shape) >= SSIM_WINDOW:
        index = structural_similarity(a, b, win_size=SSIM_WINDOW, data_range=1.0, channel_axis=-1, full=True)[1]
        ssim = float(np.mean(index[inside]))
    rms = float(np.sqrt(np.mean(difference**2) / np.mean(photograph[mask].astype(np.float64) ** 2)))
    return PictureQuality(rms_relative=rms, psnr=psnr, ssim=ssim)


def assess(views: Sequence[ViewPictures]) -> Quality:
    """Quality of each view; overall, each number's mean over the views where it exists, None if in none."""
    each = [compare(view.photograph, view.fit, view.mask) for view in views]
    overall = PictureQuality(**{number: _mean(each, number) for number in PictureQuality.model_fields})
    named = tuple(
        PhotographQuality(name=view.name, **quality.model_dump()) for view, quality in zip(views, each, strict=True)
    )
    return Quality(overall=overall, photographs=named)


def _box(picture: np.ndarray, mask: Bool[np.ndarray, "h w"]) -> np.ndarray:
    """The part of `picture` in the mask's bounding box; the mask is not empty."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _mean(qualities: Sequence[PictureQuality], number: str) -> float | None:
    values = [getattr(quality, number) for quality in qualities if getattr(quality, number) is not None]
    return float(np.mean(values)) if values else None
