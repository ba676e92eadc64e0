"""Likelihood of a metal's F0 and tint by the photographs alone, without the fit's prior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.least_squares.covariance import Covariance
from fit_material.fitter.least_squares.reduced_residuals import ReducedResiduals
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import TINT_WIDTH, MetalCoordinates
from fit_material.fitter.metal_prior.catalogue_distribution import Shape
from fit_material.fitter.metal_prior.nearest_metals import covariance_of
from fit_material.fitter.uncertainty.deviance import Deviance, dispersion_of
from fit_material.shaders.optics import fresnel

if TYPE_CHECKING:
    from fit_material.fitter.estimation.coarse_to_fine import Fit

COS_D = (0.7, 0.5, 0.34)  # 45°, 60°, 70°: the mean reflectance there follows the tint that pictures determine
FAR = 2.0  # tints: beyond, every curve is flat
SHAPE = MetalCoordinates(WidthInterval(0.0, 1.0))  # of whose free vector the shape is the beginning


class Likelihood(Protocol):
    """exp(-½ (|deviations|² - least)).

    Attributes:
        f0: that was found.
        freedom: how many reflectances the photographs see.
        least: |deviations|² of the solution.
    """

    @property
    def f0(self) -> Float[Tensor, "3"]: ...

    @property
    def freedom(self) -> int: ...

    @property
    def least(self) -> float: ...

    def __call__(self, shape: Shape) -> Float[Tensor, "*s y"]:
        """The deviations of a metal of that shape from the photographs, in standard deviations."""
        ...

    def slope(self, shape: Float[Tensor, "6"]) -> Float[Tensor, "y 6"]:
        """Their Jacobian."""
        ...


def likelihood(fit: Fit, spread: Covariance) -> Likelihood:
    """By the pictures themselves where the fit can be condensed, else by two reflectances in each channel.

    Args:
        fit, spread: of a metal, and the covariance of its free vector.
    """
    coordinates = fit.residuals.coordinates
    assert isinstance(coordinates, MetalCoordinates)
    if coordinates.tint is None and fit.condensate is not None:
        return InPictures.around(fit.condensate, fit.x, coordinates, spread)
    return InReflectance.around(fit.x, coordinates, spread)


@dataclass(frozen=True)
class InPictures:
    """The condensed residuals, as they are away from what was found: where the tint bends them, no normal distribution.

    What else was fitted, the roughness first, follows the shape as far as the residuals are linear in it: their part
    along it is left out.

    Attributes:
        condensate: of the fit.
        x: its free vector.
        shape: where its numbers of n and k lie, at the beginning.
        removed: δ of `valley.Deviance`.
        along: orthonormal columns that span what the rest of the free vector does to the residuals.
        scale: √κ: how many of the weights' standard deviations one of the noise is.
    """

    condensate: ReducedResiduals
    x: Float[Tensor, " x"]
    shape: slice
    removed: Float[Tensor, " r"]
    along: Float[Tensor, "y z"]
    scale: Float[Tensor, ""]

    freedom = 6

    @staticmethod
    def around(
        condensate: ReducedResiduals, x: Float[Tensor, " x"], coordinates: MetalCoordinates, spread: Covariance
    ) -> InPictures:
        shape = coordinates.shape
        own = torch.eye(len(x), dtype=x.dtype)[shape]
        valley = Deviance.around(condensate, lambda x: x[shape], x, dispersion_of(condensate, x, own, spread))
        known = valley.dispersion[valley.dispersion.isfinite()]
        scale = (known.median() if len(known) else torch.ones_like(x[0])).sqrt()
        of_rest = _without_tints(condensate, condensate.jacobian(x))[:, shape.stop :]
        return InPictures(condensate, x, shape, valley.removed, torch.linalg.qr(of_rest).Q, scale)

    @property
    def f0(self) -> Float[Tensor, "3"]:
        return torch.sigmoid(self.x[SHAPE.slices["reflectivity"]])

    @property
    def least(self) -> float:
        return float(self(self.x[self.shape]).square().sum())

    def __call__(self, shape: Shape) -> Float[Tensor, "*s y"]:
        free = torch.cat([shape, self.x[self.shape.stop :].expand(*shape.shape[:-1], -1)], -1)
        residuals = torch.vmap(lambda x: self.condensate(x))(free.reshape(-1, len(self.x)))
        return self._across(_without_tints(self.condensate, (residuals - self.removed).T)).T.reshape(
            *shape.shape[:-1], -1
        )

    def slope(self, shape: Float[Tensor, "6"]) -> Float[Tensor, "y 6"]:
        jacobian = self.condensate.jacobian(torch.cat([shape, self.x[self.shape.stop :]]))
        return self._across(_without_tints(self.condensate, jacobian[:, self.shape]))

    def _across(self, residuals: Float[Tensor, "y q"]) -> Float[Tensor, "y q"]:
        return (residuals - self.along @ (self.along.T @ residuals)) / self.scale


def _without_tints(condensate: ReducedResiduals, rows: Float[Tensor, "r q"]) -> Float[Tensor, "y q"]:
    """The rows but those of the prior on the tints, with which the coordinates' own prior begins."""
    first = sum(len(root) for root in condensate.roots)
    return torch.cat([rows[:first], rows[first + 3 :]])


@dataclass(frozen=True)
class InReflectance:
    """A normal distribution of reflectances y: F0, and of larger angles if they are seen; exp(-½ |root (y - found)|²).

    Pictures are linear in reflectance, if not all in this one: between 45° and 70° it stands for all angles. Where
    little is known of the tint it stands for them badly.
    """

    found: Float[Tensor, " y"]
    root: Float[Tensor, "y y"]

    least = 0.0

    @staticmethod
    def around(x: Float[Tensor, " x"], coordinates: MetalCoordinates, spread: Covariance) -> InReflectance:
        """Without the wide prior on tint that the fit holds already."""
        count = coordinates.shape.stop
        at = x[coordinates.shape] if coordinates.tint is None else torch.cat([x[coordinates.shape], coordinates.tint])

        own = covariance_of(lambda each: each, x[:count], Covariance(spread.covariance[:count, :count]))
        precision = torch.linalg.inv(own + 1e-10 * torch.eye(count, dtype=own.dtype))
        precision[3:, 3:] -= torch.eye(count - 3, dtype=own.dtype) / TINT_WIDTH**2
        back = torch.linalg.inv(_slope(at, 1 / precision.diagonal()[3:].clamp_min(1 / FAR**2).sqrt())[:count, :count])
        power, vectors = torch.linalg.eigh(back.T @ precision @ back)
        return InReflectance(_reflectances(at)[:count], power.clamp_min(0).sqrt()[:, None] * vectors.T)

    @property
    def f0(self) -> Float[Tensor, "3"]:
        return self.found[:3]

    @property
    def freedom(self) -> int:
        return len(self.found)

    def __call__(self, shape: Shape) -> Float[Tensor, "*s y"]:
        return (_reflectances(shape)[..., : len(self.found)] - self.found) @ self.root.T

    def slope(self, shape: Float[Tensor, "6"]) -> Float[Tensor, "y 6"]:
        return self.root @ _slope(shape)[: len(self.found)]


def indices(shape: Shape) -> tuple[Float[Tensor, "*s 3"], Float[Tensor, "*s 3"]]:
    """n and k."""
    metal = SHAPE.material(torch.cat([shape.movedim(-1, 0), torch.zeros_like(shape[None, ..., 0])]))
    return metal.n.movedim(0, -1), metal.k.movedim(0, -1)


def _slope(shape: Float[Tensor, "6"], reach: Float[Tensor, " t"] | None = None) -> Float[Tensor, "6 6"]:
    """Jacobian of `_reflectances`. Each depends on its own channel alone, so that sums have all their derivatives.

    Args:
        reach: half widths of secants along the three tints, in the place of tangents: where a tint is hardly known, its
            curve is flat in places, and a tangent there would take undetermined directions for exactly known ones.
    """
    shape = shape.detach().requires_grad_()
    halves = _reflectances(shape).reshape(2, 3).sum(1)
    rows = [torch.autograd.grad(half, shape, retain_graph=True)[0] for half in halves]
    slope = torch.cat([torch.cat([row[:3].diag(), row[3:].diag()], 1) for row in rows])
    if reach is not None and len(reach):
        way = torch.cat([torch.zeros_like(reach), reach])
        ends = [_reflectances(shape.detach() + sign * way)[3:] for sign in (-1, 1)]
        slope[3:, 3:] = ((ends[1] - ends[0]) / (2 * reach)).diag()
    return slope


def _reflectances(shape: Shape) -> Float[Tensor, "*s 6"]:
    """F0, and the mean reflectance from 45° to 70°, which grows steadily as the tint falls."""
    n, k = indices(shape)
    cos_d = torch.tensor(COS_D, dtype=torch.float64)[:, None]
    grazing = fresnel.conductor(cos_d, n[..., None, :], k[..., None, :]).mean(-2)
    return torch.cat([fresnel.normal_reflectance(n, k), grazing], -1)
