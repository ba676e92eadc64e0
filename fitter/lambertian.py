"""What is told of a matte fit that went beyond what materials can be: their reflectance ends at the Lambertian's 1.

A fit may pass it, so that its error can be told; but the colour that it found there goes with that reflectance and with
no other. So what is reported is the fit whose reflectance is held at 1, where the free one came out above.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitter.parameters import Coordinates, MatteCoordinates
from fitter.search import Fit
from fitter.solve import levenberg_marquardt
from fitter.uncertainty import Spread, spread
from shaders.materials import Material, Matte


@dataclass(frozen=True)
class LambertianCoordinates(Coordinates):
    """The free vector of a matte material without the reflectances that are held at 1.

    Attributes:
        whole: the free vector with them.
        held: which of its own numbers they are.
    """

    whole: MatteCoordinates
    held: Bool[Tensor, " m"]
    roughness = None

    @property
    def size(self) -> int:
        return int((~self.held).sum())

    def material(self, x: Float[Tensor, " x"]) -> Matte:
        return self.whole.material(self.completed(x))

    def free(self, material: Material) -> Float[Tensor, " x"]:
        return self.without(self.whole.free(material))

    def completed(self, x: Float[Tensor, " x"]) -> Float[Tensor, " whole"]:
        """With the numbers that are held, and all that comes after a material's own."""
        place = ((~self.held).cumsum(0) - 1).clamp_min(0)
        return torch.cat([torch.where(self.held, self.whole.lambert, x[place]), x[self.size :]])

    def without(self, whole: Float[Tensor, " whole"]) -> Float[Tensor, " x"]:
        """The inverse of `completed`."""
        return whole[self.kept(len(whole))]

    def kept(self, count: int) -> Bool[Tensor, " whole"]:
        """Which of so many numbers, a material's own and what comes after, are not held."""
        return torch.cat([~self.held, self.held.new_ones(count - len(self.held))])


def reported(fit: Fit) -> tuple[Fit, Spread]:
    """A fit as material, pictures and exposures are told from it, and the covariance of its free vector.

    Reflectances that are held keep the errors C_rr that they have where they are free, with which those of the other
    numbers, which have them held, do not go together.
    """
    coordinates, uncertainty = fit.residuals.coordinates, spread(fit.residuals, fit.x)
    if not isinstance(coordinates, MatteCoordinates):
        return fit, uncertainty
    held = coordinates.beyond_lambert(fit.x)
    if not held.any():
        return fit, uncertainty
    lambertian = _lambertian(fit, coordinates, held)
    holding = lambertian.residuals.coordinates
    assert isinstance(holding, LambertianCoordinates)
    kept = holding.kept(len(fit.x))
    covariance = torch.where(torch.outer(~kept, ~kept), uncertainty.covariance, 0.0)
    covariance[torch.outer(kept, kept)] = spread(lambertian.residuals, lambertian.x).covariance.flatten()
    return replace(lambertian, residuals=fit.residuals, x=holding.completed(lambertian.x)), Spread(covariance)


def _lambertian(fit: Fit, coordinates: MatteCoordinates, held: Bool[Tensor, " m"]) -> Fit:
    """The fit with these held, and those that pass 1 on account of it.

    It is stopped where either is, and has the steps of the free one, which is what a user waits for.
    """
    holding = LambertianCoordinates(coordinates, held)
    residuals = replace(fit.residuals, coordinates=holding)
    solution = levenberg_marquardt(residuals, holding.without(fit.x))
    further = coordinates.beyond_lambert(holding.completed(solution.x))
    if further.any():
        return _lambertian(fit, coordinates, held | further)
    ended = solution if solution.status == "stopped" else fit.solution
    return Fit(residuals, ended, solution.x, fit.solve_seconds + solution.seconds)
