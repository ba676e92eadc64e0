"""Normals of microfacets, GGX and Beckmann: their density, Smith's shadowing, and the sampling of visible ones.

All work in the frame of one point: z is the surface normal and the view direction lies in the xz plane,
v = (sin θ, 0, cos θ). An isotropic lobe needs no other frame. Components are separate tensors rather than a trailing
axis of three, which keeps every operation contiguous.
"""

from __future__ import annotations

import math
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.optics.safe_sqrt import root

Distribution = Literal["ggx", "beckmann"]


MIRROR = 1e-6  # ρ or α of a mirror: directions in float32 resolve no lobe as narrow, and 1/σ³ would leave its range


FAR = 200.0  # squared slopes beyond which Beckmann's exponential, 1e-87, is none


def distribution_of_normals(
    cos_h: Float[Tensor, "*p"],
    alpha: Float[Tensor, ...],
    distribution: Distribution,
    sin2_h: Float[Tensor, "*p"] | None = None,
) -> Float[Tensor, "*p"]:
    """D(h), the density of microfacet normals per solid angle and projected area.

        GGX       D = α² / (π [cos²(α² + tan²)]²)        [Walter 2007, eq. 33]
        Beckmann  D = exp(-tan²/α²) / (π α² cos⁴)        [Walter 2007, eq. 25]

    Args:
        cos_h: cosine between microfacet and surface normal, in (0, 1].
        alpha: α, microfacet width, >= 0; below `MIRROR` it counts as that.
        sin2_h: squared sine of the same angle, from the half vector's components: a cosine in float32 all but rounds to
            1 within a lobe of α = 10⁻³; made of the cosine where it is left out.

    Returns:
        D, in 1/steradian; ∫ D cos dω = 1 over the hemisphere.
    """
    alpha = alpha.clamp_min(MIRROR)  # a mirror's D is no number
    cos2 = cos_h**2
    sin2 = (1 - cos_h) * (1 + cos_h) if sin2_h is None else sin2_h
    if distribution == "ggx":
        return alpha**2 / (math.pi * (cos2 * alpha**2 + sin2) ** 2)
    near = sin2 < FAR * cos2 * alpha**2  # elsewhere 0 · ∞: the exponential is none, and what it is divided by, too
    cos2 = torch.where(near, cos2, 1.0)
    gaussian = torch.exp(-torch.where(near, sin2, 0.0) / (cos2 * alpha**2))
    return torch.where(near, gaussian / (math.pi * (alpha * cos2) ** 2), 0.0)


def smith_g1(cos: Float[Tensor, "*p"], alpha: Float[Tensor, ...], distribution: Distribution) -> Float[Tensor, "*p"]:
    """G1, the share of microfacets that a direction sees unmasked, under Smith's assumption.

        GGX       G1 = 2 / (1 + √(1 + α² tan²))                               [Walter 2007, eq. 34]
        Beckmann  G1 = (3.535a + 2.181a²)/(1 + 2.276a + 2.577a²), a = 1/(α tan) < 1.6, else 1
                                                                              [Walter 2007, after eq. 27]

    The rational form of Beckmann's G1 (relative error below 0.35 %) is the one that Mitsuba computes, too.

    Args:
        cos: cosine between the direction and the surface normal; 0 is returned where its square is not positive.
        alpha: α, microfacet width, >= 0.

    Returns:
        G1, in [0, 1].
    """
    front = cos > torch.finfo(cos.dtype).tiny ** 0.5  # a cosine whose square underflows would have G1 = 2
    cos = torch.where(front, cos, 1.0)
    sin2 = ((1 - cos) * (1 + cos)).clamp_min(0)
    if distribution == "ggx":
        g1 = 2 * cos / (cos + (cos**2 + alpha**2 * sin2).sqrt())
    else:
        across = alpha * root(sin2)
        masked = cos < 1.6 * across  # else nothing is, and a is infinite for α = 0 and for tan = 0
        a = cos / torch.where(masked, across, 1.0)
        g1 = torch.where(masked, (3.535 + 2.181 * a) * a / (1 + (2.276 + 2.577 * a) * a), 1.0)
    return torch.where(front, g1, 0.0)


def sample_visible_normals(
    cos_v: Float[Tensor, "*p"], alpha: float | Float[Tensor, ...], u1: Float[Tensor, "*p"], u2: Float[Tensor, "*p"]
) -> tuple[Float[Tensor, "*p"], Float[Tensor, "*p"], Float[Tensor, "*p"]]:
    """GGX microfacet normals in proportion to the area that the viewer sees of them [Heitz 2018, listing 1].

    Args:
        cos_v: n·v, in (0, 1]; v = (√(1-cos_v²), 0, cos_v).
        alpha: α, microfacet width, >= 0; a tensor broadcasts against `cos_v`, and the normals are differentiable in it.
        u1, u2: uniform numbers in [0, 1).

    Returns:
        x, y, z of unit normals h with density G1(v) max(0, v·h) D(h) / (n·v).
    """
    sin_v = root((1 - cos_v) * (1 + cos_v))
    stretch = torch.rsqrt((alpha * sin_v) ** 2 + cos_v**2)
    vx, vz = alpha * sin_v * stretch, cos_v * stretch
    radius, azimuth = u1.sqrt(), 2 * math.pi * u2
    t1 = radius * torch.cos(azimuth)
    s = 0.5 * (1 + vz)
    t2 = (1 - s) * root(1 - t1**2) + s * radius * torch.sin(azimuth)
    t3 = root(1 - t1**2 - t2**2)
    hx, hy = alpha * (t3 * vx - t2 * vz), alpha * t1
    hz = (t2 * vx + t3 * vz).clamp_min(0)
    scale = torch.rsqrt(hx**2 + hy**2 + hz**2)
    return hx * scale, hy * scale, hz * scale


def visible_normal_density(
    cos_v: Float[Tensor, "*p"], cos_h: Float[Tensor, "*p"], alpha: float, sin2_h: Float[Tensor, "*p"] | None = None
) -> Float[Tensor, "*p"]:
    """Density per steradian of v mirrored by normals of `sample_visible_normals`, G1(v) D(h) / (4 n·v) [Heitz 2018].

    Args:
        cos_v, cos_h: cosines of view and microfacet normal against the surface normal, in (0, 1].
        alpha: α, microfacet width, > 0.
        sin2_h: as for `distribution_of_normals`.
    """
    width = cos_h.new_tensor(alpha)
    return smith_g1(cos_v, width, "ggx") * distribution_of_normals(cos_h, width, "ggx", sin2_h) / (4 * cos_v)


def reflected(
    cos_v: Float[Tensor, "*p"],
    cos_l: Float[Tensor, "*p"],
    cos_h: Float[Tensor, "*p"],
    alpha: float | Float[Tensor, ...],
    distribution: Distribution,
    sin2_h: Float[Tensor, "*p"] | None = None,
) -> Float[Tensor, "*p"]:
    """BRDF · n·l without the reflectance F: D(h) G1(v) G1(l) / (4 n·v) [Walter 2007, eq. 20, 23].

    Masking and shadowing are taken for independent, as Mitsuba takes them.

    Args:
        cos_v, cos_l, cos_h: cosines of view, light and half vector against the surface normal; view and half vector
            in (0, 1].
        alpha: α, microfacet width, > 0.
        sin2_h: as for `distribution_of_normals`.

    Returns:
        in 1/steradian; 0 for light from below the horizon.
    """
    width = torch.as_tensor(alpha, dtype=cos_h.dtype, device=cos_h.device)  # of a number all digits
    unmasked = smith_g1(cos_v, width, distribution) * smith_g1(cos_l, width, distribution)
    return distribution_of_normals(cos_h, width, distribution, sin2_h) * unmasked / (4 * cos_v)
