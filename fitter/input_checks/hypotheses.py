"""Hypotheses about faults of light and photographs, and how well each explains the pixels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.input_checks.candidate_pictures import CoarseLight, Pictures
from fit_material.fitter.input_checks.coarse_fit import AssumedPhotographs, Explanation, explain
from fit_material.fitter.input_checks.orientation import GIVEN, Orientation
from fit_material.fitter.input_checks.sampled_pixels import SampledPixels
from fit_material.shaders.tone_mapping import srgb

NuisanceFactors = Literal["as said", "each", "all"]
BATCH = 8  # orientations integrated at a time, which bounds the memory
ROUNDS = 4  # in which materials and gains take turns


@dataclass(frozen=True)
class Hypothesis:
    """How things may be.

    Attributes:
        orientation: of the environment.
        recoded: photographs whose encoding is the other one of sRGB and linear than is declared.
        gains: whether exposures are as declared, or each photograph's is another, or all of them by one factor.
    """

    orientation: Orientation = GIVEN
    recoded: frozenset[int] = frozenset()
    gains: NuisanceFactors = "as said"


@dataclass(frozen=True)
class Trial:
    """How well a supposition explains the photographs.

    Attributes:
        misfit: mean relative difference over all pixels.
        gains: brightness of each photograph over the declared one.
    """

    misfit: float
    gains: Float[Tensor, " i"]


@dataclass(frozen=True)
class HypothesisTest:
    """What suppositions are tried with.

    Attributes:
        looks: the pixels of each material.
        light: of the scene.
        declared_linear: of each photograph, whether its pixels are declared linear.
        seed: of the integration.
    """

    looks: Sequence[SampledPixels]
    light: CoarseLight
    declared_linear: Bool[Tensor, " i"]
    seed: int = 0
    _pictures: dict[Orientation, list[Pictures]] = field(default_factory=dict)

    def prepare(self, orientations: Iterable[Orientation]) -> None:
        """Integrate the light of those orientations that are not integrated yet."""
        missing = [each for each in orientations if each not in self._pictures]
        for start in range(0, len(missing), BATCH):
            batch = missing[start : start + BATCH]
            found = [self.light.pictures(looks, batch, self.seed) for looks in self.looks]
            for index, orientation in enumerate(batch):
                self._pictures[orientation] = [each[index : index + 1] for each in found]

    @property
    def brightness(self) -> float:
        """Mean radiance over that of a white matte object in this light, of the brightest material; 1 in no light."""
        self.prepare([GIVEN])
        ratios = [
            float(looks.seen.mean() / picture.diffuse[0].mean())
            for looks, picture in zip(self.looks, self._pictures[GIVEN], strict=True)
            if float(picture.diffuse[0].mean()) > 0
        ]
        return max(ratios, default=1.0)

    def misfit(self, supposition: Hypothesis) -> float:
        return self.trial(supposition).misfit

    def trial(self, supposition: Hypothesis) -> Trial:
        """The best materials under a supposition."""
        self.prepare([supposition.orientation])
        gains = torch.ones(len(self.declared_linear))
        explained = self._explained(supposition, gains)
        if supposition.gains == "as said":
            return Trial(self._mean(explained), gains)
        for _ in range(ROUNDS):
            gains = self._gains(supposition, explained)
            explained = self._explained(supposition, gains)
        return Trial(self._mean(explained), gains)

    def _explained(self, supposition: Hypothesis, gains: Float[Tensor, " i"]) -> list[Explanation]:
        pictures = self._pictures[supposition.orientation]
        return [
            explain(picture, self._seen(looks, supposition, gains))
            for looks, picture in zip(self.looks, pictures, strict=True)
        ]

    def _seen(self, looks: SampledPixels, supposition: Hypothesis, gains: Float[Tensor, " i"]) -> AssumedPhotographs:
        linear = self.declared_linear[looks.photograph]
        recoded = torch.tensor([int(i) in supposition.recoded for i in looks.photograph])

        def curve(pixels: Tensor) -> Tensor:
            return torch.where(recoded & linear, _decoded(pixels), torch.where(recoded, _encoded(pixels), pixels))

        def coded(pixels: Tensor) -> Tensor:
            return torch.where(recoded & linear, _encoded(pixels), torch.where(recoded, _decoded(pixels), pixels))

        return (
            AssumedPhotographs.of(looks, curve, coded, gains)
            if recoded.any()
            else AssumedPhotographs.of(looks, _same, _same, gains)
        )

    def _mean(self, explained: Sequence[Explanation]) -> float:
        """Over the pixels of all materials."""
        counts = [looks.seen.shape[1] for looks in self.looks]
        total = sum(count * float(each.misfit[0]) for count, each in zip(counts, explained, strict=True))
        return total / sum(counts)

    def _gains(self, supposition: Hypothesis, explained: Sequence[Explanation]) -> Float[Tensor, " i"]:
        """The median ratio between photograph and picture, of each photograph or of all."""
        one = torch.ones(len(self.declared_linear))
        ratios, photographs = [], []
        for looks, each in zip(self.looks, explained, strict=True):
            radiance, picture = self._seen(looks, supposition, one).radiance, each.picture[0]
            ratios.append((radiance / picture).T.flatten())
            photographs.append(looks.photograph.repeat_interleave(3))
        ratio, photograph = torch.cat(ratios), torch.cat(photographs)
        known = ratio.isfinite() & (ratio > 0)
        if supposition.gains == "all":
            return one * (ratio[known].median() if known.any() else 1.0)
        own = [ratio[known & (photograph == index)] for index in range(len(one))]
        return _anchored(torch.stack([each.median() if len(each) else torch.ones(()) for each in own]))


def _anchored(gains: Float[Tensor, " i"]) -> Float[Tensor, " i"]:
    """Relative to their lower median: most photographs are taken for right."""
    return gains / gains.median()


def _same(pixels: Tensor) -> Tensor:
    return pixels


def _encoded(pixels: Float[Tensor, "*q"]) -> Float[Tensor, "*q"]:
    return srgb(pixels.clamp_min(0))


def _decoded(pixels: Float[Tensor, "*q"]) -> Float[Tensor, "*q"]:
    """The inverse of `srgb`; to import kornia's takes as long as all of the preflight."""
    pixels = pixels.clamp_min(0)
    return torch.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)
