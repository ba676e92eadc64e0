"""What the catalogue leads one to expect of a metal: normal distributions of F0 and tint, of known ones and others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.materials.metal import tint_of
from fit_material.renderer.materials.catalogue import Metal
from fit_material.shaders.optics import fresnel

# How far one published measurement of a metal lies from the mean of its metal's, as robust standard deviations (1.48
# medians) over 36 measurements of 13 metals (Au, Ag, Cu, Al, Fe, Ni, Cr, Ti, W, Pt, Zn, Co, Mo: RefractiveIndex.INFO's
# at 630, 532, 465 nm): of logit F0 and of tint, what all channels share and what each has for itself. A surface that
# reflects more has a lower tint: the correlation of both.
SHARED = (0.70, 0.15)
OWN = (0.10, 0.04)
CORRELATION = -0.69
UNKNOWN_WIDTH = 2.0  # times the catalogue's own scatter, is theirs

Shape = Float[Tensor, "*s 6"]
"""logit F0 and tint (`parameters.tint_of`), red, green, blue."""


@dataclass(frozen=True)
class Expected:
    """A normal distribution of shapes."""

    mean: Float[Tensor, "6"]
    covariance: Float[Tensor, "6 6"]

    def __call__(self, shape: Shape) -> Shape:
        """The deviation from the mean in independent standard deviations."""
        return (shape - self.mean) @ self.slope.T

    @property
    def slope(self) -> Float[Tensor, "6 6"]:
        return torch.linalg.inv(torch.linalg.cholesky(self.covariance))

    @property
    def log_density(self) -> Float[Tensor, ""]:
        """At the mean."""
        return -0.5 * torch.logdet(2 * math.pi * self.covariance)


def expectations(metals: Sequence[Metal]) -> list[Expected]:
    """Of each known metal, and of one that is not known."""
    shapes, width = torch.stack([shape_of(metal) for metal in metals]), published_covariance()
    about = shapes - shapes.mean(0)
    scatter = about.T @ about / max(1, len(metals) - 1)
    return [
        *(Expected(shape, width) for shape in shapes),
        Expected(shapes.mean(0), UNKNOWN_WIDTH**2 * scatter + width),
    ]


def published_covariance() -> Float[Tensor, "6 6"]:
    """Covariance of the difference in shape between two measurements of one metal: twice that of either."""

    def pair(widths: tuple[float, float]) -> Tensor:
        sigma = torch.tensor(widths, dtype=torch.float64)
        return torch.outer(sigma, sigma) * torch.tensor([[1, CORRELATION], [CORRELATION, 1]], dtype=torch.float64)

    every, each = torch.ones(3, 3, dtype=torch.float64), torch.eye(3, dtype=torch.float64)
    return 2 * (torch.kron(pair(SHARED), every) + torch.kron(pair(OWN), each))


def shape_of(metal: Metal) -> Float[Tensor, "6"]:
    n, k = (torch.tensor(each, dtype=torch.float64) for each in (metal.n, metal.k))
    return torch.cat([torch.logit(fresnel.normal_reflectance(n, k)), tint_of(n, k)])
