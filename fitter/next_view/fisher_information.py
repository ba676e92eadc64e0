"""Fisher information of pictures about a material, taken or not, and the errors that it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.least_squares.jacobian import jacobian
from fit_material.fitter.least_squares.noise import NEIGHBOURS, relative_weight
from fit_material.fitter.materials.coordinates import Coordinates
from fit_material.fitter.observations.view_sampling import ANGLE_BINS, View, histogram, taken_evenly
from fit_material.renderer.light_tables.light_table import reflect
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.shaders.materials.kinds import KINDS, MaterialType

LEAST = 1e-6  # relative noise of photographs that have none: the rounding of float32 tables
UNSEEN = 0.01  # the same where no photograph shows any pixel
VAGUE = 10.0  # standard deviation of a free number of which nothing is known: its domain ends there


@dataclass(frozen=True)
class ViewInformation:
    """Fisher information of each of several pictures about one material.

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
    noise: Float[Tensor, " p"],
) -> ViewInformation:
    """Fisher information of pictures about a free vector.

        I = Σ_i g_i g_iᵀ / σ_i²,   g_i = ∂L_i/∂x / |L_i|

    the Fisher information of independent normal errors, for each angle over the number of its pixels; |L| is the
    radiance at x, that of the darkest pixels raised as `noise.relative_weight` has it.

    Args:
        views: samples of the pictures' pixels.
        radiance: of all these pixels, one picture after another, as a function of the free vector.
        x: the free vector.
        noise: σ, standard deviation of each pixel relative to |L|, alike in all channels.
    """
    sizes = [len(view.pixels) for view in views]
    weights = torch.cat([relative_weight(picture) if len(picture) else picture for picture in radiance(x).split(sizes)])
    gradients = jacobian(radiance, x) * (weights / noise[:, None])[..., None]
    per_pixel = [_per_pixel(view, part) for view, part in zip(views, gradients.split(sizes), strict=True)]
    return ViewInformation(torch.stack(per_pixel), torch.stack([view.available for view in views]))


def _per_pixel(view: View, gradient: Float[Tensor, "p 3 x"]) -> Float[Tensor, "bins x x"]:
    """Mean g gᵀ of each angle's pixels, their channels added; g in standard deviations."""
    gradient = gradient.nan_to_num(0.0, 0.0, 0.0)
    size = gradient.shape[-1]
    products = torch.einsum("pcx,pcy->pxy", gradient, gradient)
    sums = gradient.new_zeros(ANGLE_BINS, size, size).index_add(0, view.angle_bin, products)
    return sums / histogram(view.angle_bin).clamp_min(1)[:, None, None]


def foreseen_noise(
    known: GBuffer, difference: Float[Tensor, "k 3"], wanted: GBuffer, kind: MaterialType
) -> Float[Tensor, " p"]:
    """The noise that pixels are to be expected to have, from that of others: the root mean square of those most alike.

    A camera's noise, or a path tracer's, depends on the light: of a pixel that mirrors the same direction at the same
    angle of the same surface, whoever sees it, it is nearly the same. That a path tracer's channels share most of it
    is left aside: how much they share changes from view to view, and a ranking by it was found to be one by chance.

    Args:
        known: [k] rays whose noise was seen.
        difference: between model and photograph there, relative to the radiance.
        wanted: [p] rays.
        kind: of the material: a metal's light is the mirrored one, a matte material's all that falls on it.

    Returns:
        standard deviations, relative to the radiance.
    """
    from scipy.spatial import KDTree

    if not len(difference) or not len(wanted.hit):
        return torch.full((len(wanted.hit),), UNSEEN, dtype=torch.float64)
    count = min(NEIGHBOURS, len(difference))
    nearest = KDTree(_place(known, kind).numpy()).query(_place(wanted, kind).numpy(), count)[1]
    squares = difference.square().mean(1)[torch.from_numpy(nearest)]
    return squares.reshape(-1, count).mean(1).sqrt().clamp_min(LEAST)


def _place(surface: GBuffer, kind: MaterialType) -> Float[Tensor, "p d"]:
    """What decides over a pixel's light: where its mirrored view goes to and how steeply, and its normal."""
    mirrored = [reflect(surface), surface.n_dot_v[..., None]] if KINDS[kind].mirrors else []
    return torch.cat([*mirrored, *([surface.normal] if KINDS[kind].has_body else [])], -1)


def covariance(
    information: Float[Tensor, "*v x x"], coordinates: Coordinates, x: Float[Tensor, " x"]
) -> Float[Tensor, "*v x x"]:
    """Inverse of the information, with the prior: the coordinates', and `VAGUE` of every number."""
    prior = jacobian(coordinates.prior, x)
    whole = information + prior.T @ prior + torch.eye(len(x), dtype=x.dtype) / VAGUE**2
    scale = whole.diagonal(dim1=-2, dim2=-1).rsqrt()  # numbers of unlike size: the inverse keeps its digits
    scaled = scale[..., :, None] * whole * scale[..., None, :]
    return scale[..., :, None] * torch.linalg.inv(scaled) * scale[..., None, :]
