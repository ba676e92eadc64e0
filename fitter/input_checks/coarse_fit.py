"""The best that a metal, a glossy or a matte material can do about a few pixels, by medians and without any solver."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.input_checks.candidate_pictures import Pictures
from fit_material.fitter.input_checks.sampled_pixels import SampledPixels
from fit_material.fitter.least_squares.noise import darkest

DIELECTRICS = (0.02, 0.04, 0.08, 0.16)  # reflectances that are tried

Curve = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class AssumedPhotographs:
    """Radiance of photographs under a hypothesis.

    Attributes:
        pixels: as the file and its declared encoding have them.
        linear: radiance times exposure, under the hypothesis.
        coded: from radiance times exposure back to such pixels.
        exposure: of each pixel.
    """

    pixels: Float[Tensor, "3 p"]
    linear: Float[Tensor, "3 p"]
    coded: Curve
    exposure: Float[Tensor, " p"]

    @staticmethod
    def of(looks: SampledPixels, curve: Curve, coded: Curve, gains: Float[Tensor, " i"]) -> AssumedPhotographs:
        """The photographs, if their pixels become linear by a curve, and each is brighter by a gain than declared."""
        pixels = looks.seen * looks.exposure
        return AssumedPhotographs(pixels, curve(pixels), coded, looks.exposure * gains[looks.photograph])

    @property
    def radiance(self) -> Float[Tensor, "3 p"]:
        return self.linear / self.exposure

    def misfit(self, picture: Float[Tensor, "*q 3 p"]) -> Float[Tensor, "*q"]:
        """Mean relative difference of a picture's pixels, 0 to 2.

        It is taken between pixels as they are, whatever is supposed of them: a curve that flattens would flatten the
        differences, too. By the mean of both, dark and bright outliers count alike and no more than 2.
        """
        pixels = self.coded(picture * self.exposure)
        dark = darkest(self.pixels.T)[:, None]
        return (2 * (pixels - self.pixels).abs() / (pixels.abs() + self.pixels.abs() + 2 * dark)).mean((-2, -1))


@dataclass(frozen=True)
class Explanation:
    """The best material for each orientation.

    Attributes:
        misfit: of its picture.
        picture: its radiance.
    """

    misfit: Float[Tensor, " o"]
    picture: Float[Tensor, "o 3 p"]


def explain(pictures: Pictures, seen: AssumedPhotographs) -> Explanation:
    """The best of all types and roughnesses."""
    best: Explanation | None = None
    for picture in _candidates(pictures, seen.radiance):
        misfit = seen.misfit(picture)  # [o, a]
        least, which = misfit.min(1)
        found = Explanation(least, picture[torch.arange(len(least)), which])
        best = found if best is None else _better(best, found)
    assert best is not None
    return best


def _better(one: Explanation, other: Explanation) -> Explanation:
    wins = other.misfit < one.misfit
    picture = torch.where(wins[:, None, None], other.picture, one.picture)
    return Explanation(torch.minimum(one.misfit, other.misfit), picture)


def _candidates(pictures: Pictures, radiance: Float[Tensor, "3 p"]) -> Iterator[Float[Tensor, "o a 3 p"]]:
    """The picture of the best reflectance or colour for each type, orientation and roughness."""
    diffuse, body = pictures.diffuse[:, None], pictures.body[:, None]
    yield diffuse * _share(diffuse, radiance)
    contrast = pictures.white - pictures.grazing
    yield pictures.grazing + contrast * _share(contrast, radiance - pictures.grazing)
    for f0 in DIELECTRICS:
        surface = pictures.grazing + contrast * f0
        yield surface + body * _share(body, radiance - surface)


def _share(unit: Float[Tensor, "*q 3 p"], radiance: Float[Tensor, "*q 3 p"]) -> Float[Tensor, "*q 3 1"]:
    """The factor in [0, 1] by which each channel of a picture comes nearest: the median of the ratios.

    Each pixel weighs alike, as in the relative difference, and no outlier moves a median.
    """
    ratio = radiance / unit.clamp_min(torch.finfo(unit.dtype).tiny)
    return ratio.nanmedian(-1, keepdim=True).values.clamp(0, 1)
