"""One vector of whitened differences between model and photographs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.fitter.forward.pixel_model import MixedPixels, PixelModel
from fit_material.fitter.forward.rotated_environment import TurnedPixels
from fit_material.fitter.least_squares.jacobian import jacobian
from fit_material.fitter.least_squares.nuisances import NuisanceFactors, PhotographBlock
from fit_material.fitter.materials.coordinates import Coordinates

ROBUST_AT = (
    6.0  # standard deviations: a path tracer's noise is skewed, and a nearer threshold would favour its low side
)
LIFTED = 2.0  # standard deviations: noise lifts some pixels above white, and just those are clipped


@dataclass(frozen=True)
class Residuals:
    """Whitened, robust differences as a function of the free vector.

    Attributes:
        model: the picture as a function of the material.
        coordinates: the material as a function of the free vector.
        photograph: radiance that was seen.
        whitening: W of each pixel's noise; see `fitter.least_squares.noise`.
        gains: factors on the picture that are fitted, too, their free numbers behind the material's; None where the
            photograph is the radiance.
        clusters: a number for each pixel, the same for those whose errors go together; None where all are independent.
        bounded: pixels of which the photograph gives lower bounds, whose whitening is diagonal; None where none is.
    """

    model: PixelModel
    coordinates: Coordinates
    photograph: Float[Tensor, "p 3"]
    whitening: Float[Tensor, "p 3 3"]
    gains: NuisanceFactors | None = None
    clusters: Int[Tensor, " p"] | None = None
    bounded: Bool[Tensor, " p"] | None = None

    @cached_property
    def halves(self) -> tuple[Residuals, Residuals]:
        """The same with either half of the light table's samples."""
        first, second = (replace(self, model=self.model.half(which)) for which in (0, 1))
        return first, second

    @property
    def rounded(self) -> Residuals:
        """The same by the light table as another processor might have rounded it."""
        return replace(self, model=self.model.rounded())

    def picture(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3"]:
        """The model's, as the photographs would show it."""
        radiance = self.model_at(x).radiance(self.coordinates.material(x))
        return radiance if self.gains is None else self.gains.factors(self.nuisance_part(x)) * radiance

    def model_at(self, x: Float[Tensor, " x"]) -> PixelModel:
        """The model in the environment rotated as in that free vector."""
        if not isinstance(self.model, TurnedPixels):
            return self.model
        assert self.gains is not None
        return self.model.at(self.gains.nuisances.steps(self.nuisance_part(x)))

    def factors(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3"] | float:
        """Pixel over radiance."""
        return 1.0 if self.gains is None else self.gains.factors(self.nuisance_part(x))

    def nuisance_part(self, x: Float[Tensor, " x"]) -> Float[Tensor, " z"]:
        """The free numbers that are not the material's."""
        return x[self.coordinates.size :]

    def rotation(self, x: Float[Tensor, " x"]) -> float:
        """Degrees by which the environment is rotated, which the problem has to be unknown."""
        assert self.gains is not None
        return float(self.gains.nuisances.rotation(self.nuisance_part(x)))

    def difference(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3"]:
        """Model less photograph; of lower bounds, the shortfall, allowing for what noise may have lifted there."""
        found = self.picture(x) - self.photograph
        if self.bounded is None:
            return found
        lifted = LIFTED / self.whitening.diagonal(dim1=1, dim2=2)
        return torch.where(self.bounded[:, None], (found + lifted).clamp_max(0), found)

    @property
    def is_measured(self) -> Bool[Tensor, " p"]:
        """Which pixels are more than bounded."""
        return torch.ones(len(self.photograph), dtype=torch.bool) if self.bounded is None else ~self.bounded

    def whitened(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3"]:
        """The differences, their noise made independent and of variance 1; outliers count by their size alone."""
        return huber(torch.einsum("prc,pc->pr", self.whitening, self.difference(x)), ROBUST_AT)

    def mixes(self, x: Float[Tensor, " x"]) -> bool:
        """Whether the picture is what the model has `mixed` by `mixing` and nothing else."""
        model = self.model_at(x)
        return isinstance(model, MixedPixels) and model.mixing(self.coordinates.material(x)) is not None

    @property
    def blocks(self) -> tuple[PhotographBlock, ...]:
        """Pixels that are mixed alike."""
        return (PhotographBlock(slice(None), 0),) if self.gains is None else self.gains.blocks

    def mixing(self, x: Float[Tensor, " x"]) -> Float[Tensor, "b q 3"]:
        """Coefficient of each mixed number, in each of the blocks."""
        model = self.model_at(x)
        assert isinstance(model, MixedPixels)
        found = model.mixing(self.coordinates.material(x))
        assert found is not None
        if self.gains is None:
            return found[None]
        factors = self.gains.nuisances.factors(self.nuisance_part(x))
        return found * torch.stack([factors[block.photograph] for block in self.blocks])[:, None]

    def slope(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3 x"]:
        """Derivative of the model; 0 where it is not finite."""

        if self.mixes(x):
            assert isinstance(self.model, MixedPixels)
            slopes = zip(self.blocks, jacobian(self.mixing, x), strict=True)
            found = torch.cat([torch.einsum("pqc,qcx->pcx", self.model.mixed(b.pixels), each) for b, each in slopes])
        else:
            found = jacobian(self.difference, x)
        return found.nan_to_num(0.0, 0.0, 0.0)

    def robust_whitening(self, x: Float[Tensor, " x"]) -> Float[Tensor, "p 3 3"]:
        """The whitening, lessened for outliers: where halves agree, least squares with it has the robust loss's slope.

        Light that was integrated badly is no outlier where the mean of its halves happens to fit: beyond the same
        threshold the variance that they imply counts in place of the noise's. Bounds that are kept count nothing.
        """
        difference = self.difference(x)
        share = (ROBUST_AT / self._length(difference).clamp_min(ROBUST_AT)).sqrt()
        if self.model.table is not None:
            first, second = (half.difference(x) for half in self.halves)
            share = share * ROBUST_AT / self._length((first - second) / 2).clamp_min(ROBUST_AT)
        whitening = self.whitening * share[:, None, None]
        if self.bounded is None:
            return whitening
        kept = self.bounded[:, None] & (difference == 0)
        return torch.where(kept[:, :, None], 0.0, whitening)

    def _length(self, difference: Float[Tensor, "p 3"]) -> Float[Tensor, " p"]:
        """In standard deviations of the noise."""
        return torch.einsum("prc,pc->pr", self.whitening, difference).norm(dim=-1)

    def prior(self, x: Float[Tensor, " x"]) -> Float[Tensor, " q"]:
        """What is known before any photograph, of variance 1."""
        own = self.coordinates.prior(x)
        return own if self.gains is None else torch.cat([own, self.gains.nuisances.prior(self.nuisance_part(x))])

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
