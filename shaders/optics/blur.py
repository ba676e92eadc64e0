"""Blur of the environment by roughness: the thesis's 49 taps, and the Gaussian that they stand for."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.optics.microfacets import MIRROR

TAPS_PER_SIDE = 3  # i, j = -3 … 3 make the thesis's 49 taps
TAP_SIGMA = 1.5  # in taps, so that σ = ρ/2 when three taps span ρ
SHORTEST = 1e-12  # of horizontal parts that have a direction; shorter ones `normalize` does not make unit vectors


def tap_weights() -> Float[Tensor, 7]:
    """Weights of one pass of the blur, ∝ exp(-½(i/1.5)²) for i = -3 … 3, summing to one [MODEL.md 3.1]."""
    i = torch.arange(-TAPS_PER_SIDE, TAPS_PER_SIDE + 1, dtype=torch.float64)
    weights = torch.exp(-0.5 * (i / TAP_SIGMA) ** 2)
    return weights / weights.sum()


def tap_axes(r: Float[Tensor, "*p 3"]) -> tuple[Float[Tensor, "*p 3"], Float[Tensor, "*p 3"]]:
    """Unit vectors K_H and K_V along which the blur spreads around `r` [thesis 3.1.3].

    K_H is perpendicular to r and parallel to the XZ plane, K_V = K_H × r; where r is parallel to ±Y, within
    `SHORTEST`, K_H = (1, 0, 0).

    Args:
        r: unit directions.

    Returns:
        K_H and K_V, unit length.
    """
    x, z = r[..., 0], r[..., 2]
    horizontal = torch.stack([z, torch.zeros_like(x), -x], -1)
    vertical_view = (x**2 + z**2 < SHORTEST**2)[..., None]
    pole = torch.tensor([1.0, 0.0, 0.0], dtype=r.dtype, device=r.device)
    k_h = torch.nn.functional.normalize(torch.where(vertical_view, pole, horizontal), dim=-1)
    return k_h, torch.linalg.cross(k_h, r)


def tap_directions(r: Float[Tensor, "*p 3"], rho: Float[Tensor, "*q"]) -> Float[Tensor, "*p 7 7 3"]:
    """The 49 directions normalise(r + (i/3)ρK_H + (j/3)ρK_V) [MODEL.md 3.1].

    Args:
        r: unit directions.
        rho: ρ, blur radius >= 0; broadcasts against the leading axes of `r`.

    Returns:
        unit directions; the first axis of taps is i (along K_H), the second j (along K_V).
    """
    k_h, k_v = tap_axes(r)
    step = torch.arange(-TAPS_PER_SIDE, TAPS_PER_SIDE + 1, dtype=r.dtype, device=r.device) / TAPS_PER_SIDE
    offset = rho[..., None] * step
    spread_h = offset[..., :, None, None] * k_h[..., None, None, :]
    spread_v = offset[..., None, :, None] * k_v[..., None, None, :]
    return torch.nn.functional.normalize(r[..., None, None, :] + spread_h + spread_v, dim=-1)


def blur(
    radiance: Callable[[Float[Tensor, "*p 3"]], Float[Tensor, "*p 3"]],
    r: Float[Tensor, "*p 3"],
    rho: Float[Tensor, "*q"],
) -> Float[Tensor, "*p 3"]:
    """The environment around r through the thesis's two passes of seven taps [MODEL.md 3.1].

    Args:
        radiance: of the environment, by direction.
        r: unit directions.
        rho: ρ, blur radius >= 0; broadcasts against the leading axes of `r`.
    """
    weights = tap_weights().to(r)
    taps = radiance(tap_directions(r, rho))
    return torch.einsum("i,j,...ijc->...c", weights.to(taps), weights.to(taps), taps)


def gaussian_offsets(samples: int, seed: int, like: Tensor) -> Float[Tensor, "2 s 2"]:
    """Two independent sets of points of a normal distribution of unit variance, by scrambled Sobol sequences.

    Args:
        samples: points in each set.
        seed: of the scrambling.
        like: a tensor of the dtype and device that are wanted.
    """
    sets = [torch.quasirandom.SobolEngine(2, scramble=True, seed=2 * seed + half) for half in (0, 1)]
    uniform = torch.stack([each.draw(samples, dtype=torch.float64) for each in sets])
    inside = torch.finfo(torch.float32).eps  # the scrambled sequence may meet 0, whose normal point is infinite
    return torch.special.ndtri(uniform.clamp(inside, 1 - inside)).to(like)


def gaussian_directions(r: Float[Tensor, "p 3"], offsets: Float[Tensor, "s 2"], rho: float) -> Float[Tensor, "p s 3"]:
    """normalise(r + σ(xK_H + yK_V)) with σ = ρ/2: of these the 49 taps are a coarse, cut-off quadrature [MODEL.md 3.1].

    Args:
        r: unit directions.
        offsets: x, y of `gaussian_offsets`.
        rho: ρ, blur radius >= 0.
    """
    k_h, k_v = tap_axes(r)
    x, y = (rho / 2 * offsets).unbind(-1)
    spread = x[:, None] * k_h[:, None] + y[:, None] * k_v[:, None]
    return torch.nn.functional.normalize(r[:, None] + spread, dim=-1)


def light_reflection(
    r: Float[Tensor, "*p 3"], towards: Float[Tensor, "*#p 3"], rho: Float[Tensor, ""]
) -> Float[Tensor, "*p 1"]:
    """A light's blurred reflection, per radiance of the light [thesis 3.1; MODEL.md 3.2].

        G(x; σ) = (2πσ²)^(-½) exp(-x²/2σ²),   x = |r - l|,   σ = ρ/2

    Args:
        r: mirrored views, unit.
        towards: l, unit.
        rho: ρ; a mirror, ρ <= `MIRROR`, shows no point light.
    """
    rough = rho > MIRROR
    sigma = torch.where(rough, rho / 2, 1.0)
    squared = (r - towards.to(r)).square().sum(-1, keepdim=True)
    gaussian = torch.exp(-squared / (2 * sigma**2)) / (math.sqrt(2 * math.pi) * sigma)
    return torch.where(rough, gaussian, 0.0)
