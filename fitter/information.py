"""What pictures tell of a material, taken or not: their Fisher information, and the errors that it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fitter.parameters import Coordinates
from fitter.sampled_view import ANGLE_BINS, View, histogram, taken_evenly

DARKEST = 0.05  # of a picture's median radiance: below, noise is no longer relative to the pixel
MAD_TO_SIGMA = 1.4826  # of a normal distribution: 1/Φ⁻¹(¾)
VAGUE = 10.0  # standard deviation of a free number of which nothing is known: its domain ends there


@dataclass(frozen=True)
class Told:
    """What each of several pictures tells of one material.

    Attributes:
        per_pixel: mean information of a pixel, by picture and angle.
        available: pixels that a fit could take, by picture and angle.
    """

    per_pixel: Float[Tensor, "v bins x x"]
    available: Float[Tensor, "v bins"]

    def information(self, count: float) -> Float[Tensor, "v x x"]:
        """JᵀWJ of each picture where a fit takes at most `count` pixels of each."""
        taken = [taken_evenly(available, count) for available in self.available]
        return (torch.stack(taken)[..., None, None] * self.per_pixel).sum(1)


def told_by(
    views: Sequence[View],
    radiance: Callable[[Float[Tensor, " x"]], Float[Tensor, "p 3"]],
    x: Float[Tensor, " x"],
    noise: Sequence[float],
) -> Told:
    """What pictures tell of a free vector.

        I = Σ_i g_i g_iᵀ / σ_i²,   g_i = ∂L_i/∂x,   σ_i = noise · max(L_i, DARKEST · median L)

    the Fisher information of independent normal errors, for each angle over the number of its pixels.

    Args:
        views: samples of the pictures' pixels.
        radiance: of all these pixels, one picture after another, as a function of the free vector.
        x: the free vector.
        noise: of each picture, relative to the radiance.
    """
    sizes = [len(view.pixels) for view in views]
    pictures, gradients = radiance(x).split(sizes), torch.func.jacfwd(radiance)(x).split(sizes)
    rows = zip(views, pictures, gradients, noise, strict=True)
    per_pixel = [
        _per_pixel(view, gradient / (scale * floored(picture))[..., None]) for view, picture, gradient, scale in rows
    ]
    return Told(torch.stack(per_pixel), torch.stack([view.available for view in views]))


def _per_pixel(view: View, gradient: Float[Tensor, "p 3 x"]) -> Float[Tensor, "bins x x"]:
    """Mean g gᵀ of each angle's pixels, their channels added; g in standard deviations."""
    gradient = gradient.nan_to_num(0.0, 0.0, 0.0)
    size = gradient.shape[-1]
    products = torch.einsum("pcx,pcy->pxy", gradient, gradient)
    sums = gradient.new_zeros(ANGLE_BINS, size, size).index_add(0, view.angle_bin, products)
    return sums / histogram(view.angle_bin).clamp_min(1)[:, None, None]


def covariance(
    information: Float[Tensor, "*v x x"], coordinates: Coordinates, x: Float[Tensor, " x"]
) -> Float[Tensor, "*v x x"]:
    """Inverse of the information, with what is known before: the coordinates' prior, and `VAGUE` of every number."""
    prior = torch.func.jacfwd(coordinates.prior)(x)
    whole = information + prior.T @ prior + torch.eye(len(x), dtype=x.dtype) / VAGUE**2
    scale = whole.diagonal(dim1=-2, dim2=-1).rsqrt()  # numbers of unlike size: the inverse keeps its digits
    scaled = scale[..., :, None] * whole * scale[..., None, :]
    return scale[..., :, None] * torch.linalg.inv(scaled) * scale[..., None, :]


def floored(radiance: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
    """What noise is relative to: the radiance, but no less than `DARKEST` of its median."""
    if not len(radiance):
        return radiance
    floor = DARKEST * radiance.median(0).values
    return torch.maximum(radiance, floor.clamp_min(torch.finfo(radiance.dtype).tiny))


def relative_noise(model: Float[Tensor, "p 3"], seen: Float[Tensor, "p 3"]) -> float:
    """Robust standard deviation of a photograph around the model, relative to the radiance."""
    return MAD_TO_SIGMA * float(((model - seen) / floored(model)).abs().median())
