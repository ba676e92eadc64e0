"""How one material's errors would shrink by further photographs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.materials.registry import FITTABLE
from fit_material.fitter.result.schema import FittedMaterial, StandardErrors
from fit_material.shaders.materials.quantities import QUANTITIES

Ratios = Mapping[str, Float[Tensor, "v c"]]
"""By parameter, for each of v cases and each channel."""

HalfWidths = StandardErrors
"""Half of each 95 % interval, by parameter; None where there is none."""


@dataclass(frozen=True)
class ExpectedGain:
    """One material as it was found, and how its errors would shrink.

    Attributes:
        material: with its intervals by the photographs that there are.
        ratio: the standard errors with one more view over those without it, for each of v views.
        finer: the same of a fit that takes more pixels of the photographs that there are; None where none does.
    """

    material: FittedMaterial
    ratio: Ratios
    finer: Ratios | None

    def score(self, ratios: Ratios) -> Float[Tensor, " v"]:
        """Logarithm of the geometric mean ratio over the decisive quantities, each of which counts as one."""
        decisive = FITTABLE[self.material.type].decisive
        return torch.stack([ratios[each.name].log().mean(1) for each in decisive]).mean(0)

    def now(self) -> HalfWidths:
        """Half widths as the fit has them."""
        return self._half_widths(lambda key, channel: 1.0)

    def expected(self, view: int) -> HalfWidths:
        """Half widths with one more view: as much narrower as the standard errors are smaller."""
        return self._half_widths(lambda key, channel: float(self.ratio[key][view, channel]))

    def _half_widths(self, factor: Callable[[str, int], float]) -> HalfWidths:
        def half(interval: tuple[float, float] | None, key: str, channel: int) -> float | None:
            return None if interval is None else factor(key, channel) * (interval[1] - interval[0]) / 2

        found = {}
        for key in self.ratio:
            intervals = getattr(self.material.interval95, key)
            if QUANTITIES[key].channels == 1:
                found[key] = half(intervals, key, 0)
            elif intervals is not None:
                found[key] = tuple(half(each, key, channel) for channel, each in enumerate(intervals))
        return HalfWidths(**found)


def geometric_mean(prospects: Sequence[ExpectedGain], ratios: Sequence[Ratios]) -> Float[Tensor, " v"]:
    """Mean ratio over the materials, each of which counts alike."""
    scores = [prospect.score(each) for prospect, each in zip(prospects, ratios, strict=True)]
    return torch.stack(scores).mean(0).exp()
