"""Light that a surface scatters: ambient light from the environment, and what the reflection leaves of it."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

COEFFICIENTS = 9

# Cosine-lobe factors Â_l / π = 1, 2/3, 1/4 of degrees 0, 1, 2 [Ramamoorthi & Hanrahan 2001, eqs. 7-9] times the
# constants of the real spherical harmonics [ibid., eq. 3].
_SCALE = (
    0.5 / math.sqrt(math.pi),
    *[2 / 3 * math.sqrt(3 / (4 * math.pi))] * 3,
    *[1 / 4 * math.sqrt(15 / (4 * math.pi))] * 3,
    1 / 4 * math.sqrt(5 / (16 * math.pi)),
    1 / 4 * math.sqrt(15 / (16 * math.pi)),
)


def harmonics(directions: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 9"]:
    """The nine real spherical harmonics of degree 0 to 2 without their constants.

        1, y, z, x, xy, yz, xz, 3z²-1, x²-y²        [Ramamoorthi & Hanrahan 2001, eq. 3]

    Args:
        directions: unit.
    """
    x, y, z = directions.unbind(-1)
    return torch.stack([torch.ones_like(x), y, z, x, x * y, y * z, x * z, 3 * z**2 - 1, x**2 - y**2], -1)


def ambient_coefficients(moments: Float[Tensor, "9 3"]) -> Float[Tensor, "9 3"]:
    """From ∫ L(ω) h_i(ω) dω, h the `harmonics`, to the coefficients of `ambient`.

    Both the projection and the reconstruction bear a harmonic's constant N_i; with the cosine lobe's factor Â_l/π
    the coefficient is Â_l/π · N_i² · moment [Ramamoorthi & Hanrahan 2001, eq. 10].
    """
    scale = moments.new_tensor(_SCALE)
    lobe = moments.new_tensor([1.0, *[2 / 3] * 3, *[1 / 4] * 5])
    return (scale**2 / lobe)[:, None] * moments


def constant_ambient(radiance: Float[Tensor, "3"]) -> Float[Tensor, "9 3"]:
    """The coefficients of ambient light that is the same from everywhere."""
    return torch.cat([radiance[None], radiance.new_zeros(COEFFICIENTS - 1, 3)])


def ambient(coefficients: Float[Tensor, "9 3"], normal: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """The environment's cosine-weighted irradiance over π: what a white Lambertian surface sends out [MODEL.md 4].

    Args:
        coefficients: of the environment, radiance.
        normal: unit.

    Returns:
        radiance >= 0; the nine harmonics overshoot below 0 opposite a small bright lamp, which is cut off.
    """
    return (harmonics(normal) @ coefficients.to(normal)).clamp_min(0)


def energy_guard(color: Float[Tensor, "*p 3"], reflectance: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """A colour that with the reflection above it returns no more than arrives.

        color / max(1, max_c color_c / (1 - F_c))        [MODEL.md 4]

    All channels are divided alike, so that the hue stays; the reflection is never reduced.

    Args:
        color, reflectance: of the body, and F of the surface above it, in [0, 1].
    """
    too_much = color + reflectance > 1
    share = torch.where(too_much, (1 - reflectance) / torch.where(too_much, color, 1.0), 1.0)
    return color * share.amin(-1, keepdim=True)
