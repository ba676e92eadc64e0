"""The lobes of a rough reflection: the thesis's 49 taps, the Gaussian they stand for, GGX and Beckmann microfacets.

Microfacet functions work in the frame of one point: z is the surface normal and the view direction lies in the xz
plane, v = (sin θ, 0, cos θ). An isotropic lobe needs no other frame. Components are separate tensors rather than a
trailing axis of three, which keeps every operation contiguous.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from shaders.root import root

Distribution = Literal["ggx", "beckmann"]

TAPS_PER_SIDE = 3  # i, j = -3 … 3 make the thesis's 49 taps
TAP_SIGMA = 1.5  # in taps, so that σ = ρ/2 when three taps span ρ
SHORTEST = 1e-12  # of horizontal parts that have a direction; shorter ones `normalize` does not make unit vectors
MIRROR = 1e-6  # ρ or α of a mirror: directions in float32 resolve no lobe as narrow, and 1/σ³ would leave its range
FAR = 200.0  # squared slopes beyond which Beckmann's exponential, 1e-87, is none


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
    r: Float[Tensor, "*p 3"], towards: Float[Tensor, "3"], rho: Float[Tensor, ""]
) -> Float[Tensor, "*p 1"]:
    """A directional light's blurred reflection, per radiance of the light [thesis 3.1; MODEL.md 3.2].

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
    width = torch.as_tensor(alpha).to(cos_h)
    unmasked = smith_g1(cos_v, width, distribution) * smith_g1(cos_l, width, distribution)
    return distribution_of_normals(cos_h, width, distribution, sin2_h) * unmasked / (4 * cos_v)
