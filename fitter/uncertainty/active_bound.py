"""Reports of matte fits beyond the physical range: reflectance ends at the Lambertian's 1.

A fit may pass it, so that its error can be stated; but the colour that it found there goes with that reflectance and
with no other. So the reported fit is the one whose reflectance is held at 1, where the free one came out above.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.least_squares.covariance import Covariance, sandwich_covariance
from fit_material.fitter.least_squares.solvers import levenberg_marquardt
from fit_material.fitter.materials.coordinates import Coordinates
from fit_material.fitter.materials.matte import MatteCoordinates
from fit_material.shaders.materials.types import Matte


@dataclass(frozen=True)
class LambertianCoordinates(Coordinates[Matte]):
    """The free vector of a matte material without the reflectances that are held at 1.

    Attributes:
        whole: the free vector with them.
        held: which of its own numbers they are.
    """

    whole: MatteCoordinates
    held: Bool[Tensor, " m"]
    width = None

    @property
    def sizes(self) -> Mapping[str, int]:
        return {name: int((~self.held[place]).sum()) for name, place in self.whole.slices.items()}

    def material(self, x: Float[Tensor, " x"]) -> Matte:
        return self.whole.material(self.completed(x))

    def free(self, material: Matte) -> Float[Tensor, " x"]:
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


def reported(fit: Fit) -> tuple[Fit, Covariance]:
    """A fit as material, pictures and exposures are derived from it, and the covariance of its free vector.

    Reflectances that are held may lie below 1 nevertheless, and what they are free to do there counts as an error of
    theirs and of the numbers that follow them: the second moment about 1 of their normal distribution, cut off there.
    """
    coordinates, uncertainty = fit.residuals.coordinates, sandwich_covariance(fit.residuals, fit.x)
    if fit.alike is not None:
        return fit, replace(uncertainty, covariance=uncertainty.covariance + fit.alike.covariance)
    if not isinstance(coordinates, MatteCoordinates):
        return fit, uncertainty
    held = coordinates.beyond_lambert(fit.x)
    if not held.any():
        return fit, uncertainty
    lambertian = _lambertian(fit, coordinates, held)
    holding = lambertian.residuals.coordinates
    assert isinstance(holding, LambertianCoordinates)
    own = sandwich_covariance(lambertian.residuals, lambertian.x).covariance
    covariance = _below_lambert(uncertainty.covariance, fit.x - coordinates.lambert, holding.kept(len(fit.x)), own)
    return replace(lambertian, residuals=fit.residuals, x=holding.completed(lambertian.x)), Covariance(covariance)


def _below_lambert(
    free: Float[Tensor, "x x"], beyond: Float[Tensor, " x"], kept: Bool[Tensor, " x"], own: Float[Tensor, "k k"]
) -> Float[Tensor, "x x"]:
    """Second moments about a fit with numbers held, of which each may be less.

    Args:
        free: covariance where all numbers are free.
        beyond: by how much a number passes, there, what it is held at.
        kept: which numbers are not held.
        own: their covariance, with the others held.
    """
    of_held = free[~kept][:, ~kept]
    follows = torch.linalg.solve(of_held, free[~kept][:, kept]).T
    sigma = of_held.diagonal().sqrt()
    moved = torch.diag(sigma**2 * _cut_off(beyond[~kept] / sigma))
    found = torch.empty_like(free)
    found[torch.outer(kept, kept)] = (own + follows @ moved @ follows.T).flatten()
    found[torch.outer(kept, ~kept)] = (follows @ moved).flatten()
    found[torch.outer(~kept, kept)] = (follows @ moved).T.flatten()
    found[torch.outer(~kept, ~kept)] = moved.flatten()
    return found


def _cut_off(z: Float[Tensor, " h"]) -> Float[Tensor, " h"]:
    """E[u² | u < 0] of a normal u of mean z and variance 1: 1 + z² - z φ(z)/Φ(-z) [Johnson et al. 1994, §13.10.1]."""
    hazard = math.sqrt(2 / math.pi) / torch.special.erfcx(z / math.sqrt(2))
    return (1 + z**2 - z * hazard).clamp(0, 1)


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
