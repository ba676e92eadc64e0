"""What two halves of a light table's samples know of a free vector, each without the other's noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.least_squares.jacobian import jacobian

if TYPE_CHECKING:
    from fit_material.fitter.least_squares.residuals import Residuals

NOTHING = 1e-100  # the precision where nothing moves the residuals at all; its inverse can still be squared
ROUNDING = 1e-14  # of the largest eigenvalue of an information matrix whose diagonal is 1
DROWNED = 0.1  # least fraction of a table's signal that is not taken for its noise
RESOLVED = 5.0  # of its own standard deviations by which information has to stand out of the table's noise


@dataclass(frozen=True)
class Halves:
    """Both halves of a light table at one free vector.

    Attributes:
        slopes: J_A, J_B, whitened.
        differences: r_A, r_B, whitened.
        prior: its residuals.
        of_prior: … and their slope.
        rounding: what another rounding of the table would add to J_A.
    """

    slopes: tuple[Float[Tensor, "p 3 x"], ...]
    differences: tuple[Float[Tensor, "p 3"], ...]
    prior: Float[Tensor, " q"]
    of_prior: Float[Tensor, "q x"]
    rounding: Float[Tensor, "p 3 x"]

    @staticmethod
    def at(x: Float[Tensor, " x"], residuals: Residuals, whitening: Float[Tensor, "p 3 3"]) -> Halves:
        slopes = tuple(torch.matmul(whitening, half.slope(x)) for half in residuals.halves)
        differences = (torch.einsum("prc,pc->pr", whitening, half.difference(x)) for half in residuals.halves)
        rounding = torch.matmul(whitening, residuals.halves[0].rounded.slope(x)) - slopes[0]
        return Halves(slopes, tuple(differences), residuals.prior(x), jacobian(residuals.prior, x), rounding)

    @property
    def crossed(self) -> Float[Tensor, ""]:
        """½ (r_A · r_B + |prior|²): half the sum of squares, but for the table's noise."""
        first, second = self.differences
        return ((first * second).sum() + self.prior.square().sum()) / 2

    @property
    def slope_of_crossed(self) -> Float[Tensor, " x"]:
        """½ (J_Aᵀ r_B + J_Bᵀ r_A) + ∇ prior."""
        return self.scores.sum(0) + self.of_prior.T @ self.prior

    @property
    def slope(self) -> Float[Tensor, "p 3 x"]:
        """Of the whole table."""
        return (self.slopes[0] + self.slopes[1]) / 2

    @property
    def noise(self) -> Float[Tensor, "p 6 x"]:
        """Errors of that slope: half the difference of the halves, and rounding."""
        return torch.cat([(self.slopes[0] - self.slopes[1]) / 2, self.rounding], 1)

    @property
    def scores(self) -> Float[Tensor, "p x"]:
        """g: each pixel's part of the cost's slope, by slopes of one half and differences of the other."""
        (first, second), (of_first, of_second) = self.slopes, self.differences
        return (torch.einsum("prx,pr->px", first, of_second) + torch.einsum("prx,pr->px", second, of_first)) / 2

    @cached_property
    def resolved(self) -> Bool[Tensor, " x"]:
        """Which free numbers change the picture by more than the noise in their slopes, all others held."""
        said = self.slope.square().sum((0, 1))
        return stands_out(said - self.noise.square().sum((0, 1)), self.noise.square().sum(1))

    @cached_property
    def information(self) -> Float[Tensor, "x x"]:
        """H, but for what does not stand out of the table's noise: those are not determined by the pictures.

        A column of slopes that is nothing but noise is no column, lest what the noise resembles by chance were not
        known, either. Of the remaining ones, every direction is tested likewise.
        """
        slope, noise = (torch.where(self.resolved, each, 0.0) for each in (self.slope, self.noise))
        said, of_noise = (each.flatten(0, 1).T @ each.flatten(0, 1) for each in (slope, noise))
        return believed(said, said - of_noise, noise) + self.of_prior.T @ self.of_prior

    @property
    def unknown(self) -> Float[Tensor, "x x"]:
        """Variance of an undetermined direction, on the scale of the slopes there, be they noise: huge, but finite.

        It is that of the rounding, and no more.
        """
        scale = _scale(self.slope.square().sum((0, 1)) + self.of_prior.square().sum(0))
        known, vectors, rounding = _directions(self.information, scale)
        ways = vectors / scale[:, None]
        return ways * torch.where(known > 0, 0.0, 1 / rounding) @ ways.T


def stands_out(information: Float[Tensor, " x"], noise: Float[Tensor, "p x"]) -> Bool[Tensor, " x"]:
    """Whether information differs from what the slopes' noise would make by chance: weak instruments are none
    [Staiger & Stock 1997].

    The product of two slopes that are independent normal noise of variance v varies by v², and the square of half their
    difference has a mean square of ¾ v²; of several channels, of which it takes the sum, more.

    Args:
        information: the sum over pixels of products of independent slopes.
        noise: |half the difference of these slopes|² of each pixel.
    """
    return information > RESOLVED * (4 / 3 * noise.square().sum(0)).sqrt()


def believed(
    said: Float[Tensor, "x x"], crossed: Float[Tensor, "x x"], noise: Float[Tensor, "p r x"] | None = None
) -> Float[Tensor, "x x"]:
    """The information in slopes that hold noise.

    Args:
        said: their products, in which the noise is information, too; symmetric.
        crossed: products of slopes whose noise is independent, in which it is not; symmetric.
        noise: of each pixel's slopes, to test whether `crossed` stands out of it.

    Returns:
        `crossed`, but in no direction less than `DROWNED` of `said`, and nothing where it does not stand out.
    """
    scale = _scale(said.diagonal())
    values, vectors, rounding = _directions(said, scale)
    size = torch.where(values > 0, values, rounding).sqrt()
    share, turn = torch.linalg.eigh((vectors / size).T @ (crossed / scale / scale[:, None]) @ (vectors / size))
    known, ways = share.clamp(DROWNED, 1.0), vectors / scale[:, None] / size @ turn
    if noise is not None:
        known = torch.where(stands_out(share, (noise @ ways).square().sum(1)), known, 0.0)
    root = scale[:, None] * (vectors * size) @ turn
    return root * known @ root.T


def inverse_of(information: Float[Tensor, "x x"]) -> Float[Tensor, "x x"]:
    """Its inverse; 0 in directions of which nothing is known."""
    scale = _scale(information.diagonal())
    known, vectors, _ = _directions(information, scale)
    ways = vectors / scale[:, None]
    return ways / torch.where(known > 0, known, torch.inf) @ ways.T


def _scale(diagonal: Float[Tensor, " x"]) -> Float[Tensor, " x"]:
    """Of each number's slopes, so that none is called rounding beside others whose unit is small; that of the largest
    where there is none."""
    return torch.where(diagonal > 0, diagonal, diagonal.max()).clamp_min(NOTHING).sqrt()


def _directions(
    information: Float[Tensor, "x x"], scale: Float[Tensor, " x"]
) -> tuple[Float[Tensor, " x"], Float[Tensor, "x x"], Tensor]:
    """Eigenvalues on that scale, those within rounding 0; eigenvectors; and what rounding is."""
    values, vectors = torch.linalg.eigh(information / scale / scale[:, None])
    rounding = (values.max() * ROUNDING).clamp_min(NOTHING)
    return torch.where(values > rounding, values, 0.0), vectors, rounding
