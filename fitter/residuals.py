"""One vector of whitened differences between model and photographs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from fitter.derivative import jacobian
from fitter.parameters import Coordinates
from fitter.pixel_model import MixedPixels, PixelModel

ROBUST_AT = (
    6.0  # standard deviations: a path tracer's noise is skewed, and a nearer threshold would favour its low side
)


@dataclass(frozen=True)
class Residuals:
    """Whitened, robust differences as a function of the free vector.

    Attributes:
        model: the picture as a function of the material.
        coordinates: the material as a function of the free vector.
        photograph: radiance that was seen.
        whitening: W of each pixel's noise; see `fitter.noise`.
    """

    model: PixelModel
    coordinates: Coordinates
    photograph: Float[Tensor, "p 3"]
    whitening: Float[Tensor, "p 3 3"]

    @cached_property
    def halves(self) -> tuple[Residuals, Residuals]:
        """The same with either half of the light table's samples."""
        first, second = (replace(self, model=self.model.half(which)) for which in (0, 1))
        return first, second

    def difference(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3"]:
        """Model less photograph."""
        return self.model.radiance(self.coordinates.material(x)) - self.photograph

    def whitened(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3"]:
        """The differences, their noise made independent and of variance 1; outliers count by their size alone."""
        return huber(torch.einsum("prc,pc->pr", self.whitening, self.difference(x)), ROBUST_AT)

    def mixes(self, x: Float[Tensor, " x"]) -> bool:
        """Whether the picture is what the model has `mixed` by `mixing` and nothing else."""
        return isinstance(self.model, MixedPixels) and self.model.mixing(self.coordinates.material(x)) is not None

    def mixing(self, x: Float[Tensor, " x"]) -> Float[Tensor, "q 3"]:
        """How much each number of what is mixed counts."""
        assert isinstance(self.model, MixedPixels)
        found = self.model.mixing(self.coordinates.material(x))
        assert found is not None
        return found

    def slope(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3 x"]:
        """Derivative of the model; 0 where it is not finite."""

        if self.mixes(x):
            assert isinstance(self.model, MixedPixels)
            found = torch.einsum("pqc,qcx->pcx", self.model.mixed(slice(None)), jacobian(self.mixing, x))
        else:
            found = jacobian(self.difference, x)
        return found.nan_to_num(0.0, 0.0, 0.0)

    def robust_whitening(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3 3"]:
        """The whitening, lessened for outliers: where halves agree, least squares with it has the robust loss's slope.

        Light that was integrated badly is no outlier where the mean of its halves happens to fit: beyond the same
        threshold the variance that they tell counts in the place of the noise's.
        """
        share = (ROBUST_AT / self._length(self.difference(x)).clamp_min(ROBUST_AT)).sqrt()
        if self.model.table is not None:
            first, second = (half.difference(x) for half in self.halves)
            share = share * ROBUST_AT / self._length((first - second) / 2).clamp_min(ROBUST_AT)
        return self.whitening * share[:, None, None]

    def _length(self, difference: Float[Tensor, "p 3"]) -> Float[Tensor, " p"]:
        """In standard deviations of the noise."""
        return torch.einsum("prc,pc->pr", self.whitening, difference).norm(dim=-1)

    def prior(self, x: Float[Tensor, " x"]) -> Float[Tensor, " q"]:
        """What is known before any photograph, of variance 1."""
        return self.coordinates.prior(x)

    def __call__(self, x: Float[Tensor, " x"]) -> Float[Tensor, " r"]:
        """The vector whose sum of squares is minimised: three numbers for each pixel, and the prior's."""
        return torch.cat([self.whitened(x).flatten(), self.prior(x)])


def huber(r: Float[Tensor, "*p c"], threshold: float) -> Float[Tensor, "*p c"]:
    """Vectors, shortened so that least squares of them is robust.

        ½|ψ|² = ½|r|² for |r| ≤ t, else t|r| - ½t²        [Huber 1964, eq. 3.4, for the length of a vector]

    Within the threshold nothing is touched at all, unlike by smooth losses: noise that is skewed keeps its mean.
    """
    squared = r.square().sum(-1, keepdim=True).clamp_min(threshold**2)  # clamped before the root, whose slope at 0 ends
    share = threshold / squared.sqrt()
    return r * (share * (2 - share)).sqrt()
