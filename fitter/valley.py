"""The deviance of a fit around what it found: how much worse other free vectors explain the photographs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.func import jacrev, vmap

from fitter.uncertainty import TWO_SIDED_95, Function, Spread


@dataclass(frozen=True)
class Valley:
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
    def around(residual: Function, quantity: Function, x: Float[Tensor, " x"], dispersion: Tensor) -> Valley:
        jacobian, r = _jacobian(residual, x), residual(x)
        removed = jacobian @ torch.linalg.lstsq(jacobian, r[:, None], driver="gelsd").solution[:, 0]
        return Valley(residual, quantity, x, removed, (r - removed).square().sum(), dispersion)

    @property
    def wanted(self) -> Float[Tensor, " q"]:
        """The deviance at the ends."""
        return TWO_SIDED_95**2 * self.dispersion

    def deviance(self, x: Float[Tensor, "e x"]) -> tuple[Tensor, Tensor, Tensor]:
        """D, [e]; half its gradient, [e, x]; JᵀJ, [e, x, x]."""
        # not jacfwd: torch 2's derivative of linalg.solve is wrong under vmap(jacfwd), and right under vmap(jacrev)
        jacobian, r = vmap(jacrev(value_and_aux(self.residual), has_aux=True))(x)
        r = r - self.removed
        gradient = torch.einsum("erx,er->ex", jacobian, r)
        return r.square().sum(-1) - self.least, gradient, torch.einsum("erx,ery->exy", jacobian, jacobian)


def dispersion_of(
    residual: Function, x: Float[Tensor, " x"], slope: Float[Tensor, "q x"], spread: Spread
) -> Float[Tensor, " q"]:
    """κ of quantities by their slopes: gᵀ C g over gᵀ (JᵀJ)⁻¹ g; infinite or NaN where nothing is known."""
    taken = torch.linalg.lstsq(_jacobian(residual, x).T, slope.T, driver="gelsd").solution  # J (JᵀJ)⁻¹ g
    return (slope @ spread.covariance * slope).sum(-1) / taken.square().sum(0)


def _jacobian(residual: Function, x: Float[Tensor, " x"]) -> Float[Tensor, "r x"]:
    """J; 0 where it is not finite."""
    return jacrev(residual)(x).nan_to_num(0.0, 0.0, 0.0)


def value_and_aux(function: Function) -> Callable[[Tensor], tuple[Tensor, Tensor]]:
    """Its value as function and auxiliary, so that `jacrev` gives both derivative and value."""

    def both(x: Tensor) -> tuple[Tensor, Tensor]:
        value = function(x)
        return value, value

    return both
