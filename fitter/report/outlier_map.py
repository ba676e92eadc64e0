"""Which pixels the fit does not explain, and how little they counted: dust, lamps and people that no map shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.fitted.part import FittedPart
from fit_material.fitter.least_squares.noise import darkest
from fit_material.fitter.least_squares.residuals import ROBUST_AT, Residuals
from fit_material.fitter.observations.album import Thumbnail
from fit_material.fitter.report.image_quality import ViewPictures

BINS = 12  # of brightness, each with as many pixels: noise goes with it
TOLD = 0.005  # share of a photograph's pixels from which its outliers are worth a sentence


@dataclass(frozen=True)
class OutlierMap:
    """One photograph's pixels against the fit; where no pixel was fitted, as its nearest neighbour that was.

    Attributes:
        name: of the photograph.
        photograph: linear Rec. 709, [h, w, 3].
        deviation: fit less photograph in standard deviations of the noise that is usual at this brightness, [h, w].
        weight: how much a pixel counted, over the usual weight at this brightness, in [0, 1], [h, w].
        mask: where the object is.
        outliers: share of the fitted pixels beyond `ROBUST_AT`.
    """

    name: str
    photograph: Float[np.ndarray, "h w 3"]
    deviation: Float[np.ndarray, "h w"]
    weight: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]
    outliers: float


def outlier_maps(
    parts: Sequence[FittedPart], thumbnails: Sequence[Thumbnail], views: Sequence[ViewPictures]
) -> list[OutlierMap]:
    """Of every photograph of which pixels were fitted, but for clipped ones: of these there is no difference.

    Args:
        parts: the fits of all materials.
        thumbnails, views: of all photographs.
    """
    place = torch.cat([part.observed.measured.place for part in parts])
    deviation, weight = (
        torch.cat(each) for each in zip(*(standardised_residuals(part.choice.fit) for part in parts), strict=True)
    )
    maps = []
    for index, (thumbnail, view) in enumerate(zip(thumbnails, views, strict=True)):
        own = place[:, 0] == index
        if not own.any() or not view.mask.any():
            continue
        nearest = _nearest(place[own, 1:], torch.from_numpy(view.mask).nonzero() * thumbnail.step)
        deviations, weights = (_filled(view.mask, each[own][nearest]) for each in (deviation, weight))
        beyond = float((deviation[own].abs() > ROBUST_AT).double().mean())
        maps.append(OutlierMap(view.name, view.photograph, deviations, weights, view.mask, beyond))
    return maps


def standardised_residuals(fit: Fit) -> tuple[Float[Tensor, " p"], Float[Tensor, " p"]]:
    """How many usual standard deviations the fit is brighter than each measured pixel, and how much of one it counted.

    What is usual is the median noise of pixels of the same brightness: beside a lamp that the map lacks, every
    neighbour is as wrong, and the noise that the fit takes from them has grown by that.
    """
    residuals, x = fit.residuals, fit.x
    own = residuals.is_measured
    picture, noise = fit.picture[own], _noise(residuals)[own]
    level = picture.mean(-1).clamp_min(float(darkest(picture).mean()))
    usual = _usual(level, noise / level) * level
    share = (residuals.robust_whitening(x).norm(dim=(1, 2)) / residuals.whitening.norm(dim=(1, 2)))[own]
    weight = (share * usual / noise).square().clamp_max(1)
    return residuals.difference(x)[own].mean(-1) / usual, weight


def outlier_sentences(maps: Sequence[OutlierMap]) -> list[str]:
    """A sentence where many pixels of a photograph are outliers."""
    many = [each for each in maps if each.outliers > TOLD]
    if not many:
        return []
    named = ", ".join(f"{each.outliers:.1%} of {each.name}" for each in many[:3])
    more = f" and {len(many) - 3} more photographs" if len(many) > 3 else ""
    return [
        f"Pixels that differ from the fit by more than {ROBUST_AT:g} standard deviations count for little: {named}"
        f"{more}. Dust, a lamp or somebody whom the environment map lacks? The report has maps of them."
    ]


def _noise(residuals: Residuals) -> Float[Tensor, " p"]:
    """Standard deviation of a pixel's mean over its channels, as the fit weighs it: |W⁻ᵀ 1|/3."""
    thirds = torch.full((len(residuals.photograph), 3, 1), 1 / 3, dtype=torch.float64)
    return torch.linalg.solve(residuals.whitening.mT, thirds)[..., 0].norm(dim=-1)


def _usual(level: Float[Tensor, " p"], relative: Float[Tensor, " p"]) -> Float[Tensor, " p"]:
    """The median over pixels of like level."""
    found = torch.empty_like(relative)
    for part in level.argsort().tensor_split(max(1, min(BINS, len(level) // BINS))):
        found[part] = relative[part].median()
    return found


def _nearest(fitted: Int[Tensor, "p 2"], shown: Int[Tensor, "s 2"]) -> Int[Tensor, " s"]:
    from scipy.spatial import KDTree

    return torch.from_numpy(np.asarray(KDTree(fitted.numpy()).query(shown.numpy(), workers=-1)[1]))


def _filled(mask: Bool[np.ndarray, "h w"], values: Float[Tensor, " s"]) -> Float[np.ndarray, "h w"]:
    found = np.zeros(mask.shape)
    found[mask] = values.numpy()
    return found
