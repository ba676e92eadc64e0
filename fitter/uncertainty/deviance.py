"""The deviance of a fit around what it found: how much worse other free vectors explain the photographs."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.least_squares.covariance import TWO_SIDED_95, Covariance
from fit_material.fitter.least_squares.jacobian import Function, jacobian, jacobians


@dataclass(frozen=True)
class Deviance:
    """The deviance D, and a quantity over it.

    Attributes:
        residual: R.
        quantity: q.
        x: where D is 0.
        removed: δ.
        least: |R(x) - δ|².
        dispersion: κ of each quantity.
    """

    residual: Function
    quantity: Function
    x: Float[Tensor, " x"]
    removed: Float[Tensor, " r"]
    least: Float[Tensor, ""]
    dispersion: Float[Tensor, " q"]

    @staticmethod
    def around(residual: Function, quantity: Function, x: Float[Tensor, " x"], dispersion: Tensor) -> Deviance:
        slope, r = _slope(residual, x), residual(x)
        removed = slope @ torch.linalg.lstsq(slope, r[:, None], driver="gelsd").solution[:, 0]
        return Deviance(residual, quantity, x, removed, (r - removed).square().sum(), dispersion)

    @property
    def wanted(self) -> Float[Tensor, " q"]:
        """The deviance at the ends."""
        return TWO_SIDED_95**2 * self.dispersion

    def deviance(self, x: Float[Tensor, "e x"]) -> tuple[Tensor, Tensor, Tensor]:
        """D, [e]; half its gradient, [e, x]; JᵀJ, [e, x, x]."""
        r, slopes = jacobians(self.residual, x)
        r = r - self.removed
        gradient = torch.einsum("erx,er->ex", slopes, r)
        return r.square().sum(-1) - self.least, gradient, torch.einsum("erx,ery->exy", slopes, slopes)


def dispersion_of(
    residual: Function, x: Float[Tensor, " x"], slope: Float[Tensor, "q x"], spread: Covariance
) -> Float[Tensor, " q"]:
    """κ of quantities by their slopes: gᵀ C g over gᵀ (JᵀJ)⁻¹ g; infinite or NaN where nothing is known."""
    taken = torch.linalg.lstsq(_slope(residual, x).T, slope.T, driver="gelsd").solution  # J (JᵀJ)⁻¹ g
    return (slope @ spread.covariance * slope).sum(-1) / taken.square().sum(0)


def _slope(residual: Function, x: Float[Tensor, " x"]) -> Float[Tensor, "r x"]:
    """J; 0 where it is not finite."""
    return jacobian(residual, x).nan_to_num(0.0, 0.0, 0.0)
