"""A rough dielectric over a diffuse body: what the interface lets in, keeps inside, and lets out again.

Light reaches the body through the interface, is scattered there evenly, and leaves it through the interface; light
that is thrown back from below is scattered again. The radiance towards v for light from l is

    color · outcoupling · T(n·v) T(n·l) / π,     outcoupling = 1 / (η² (1 - R))

with T the interface's transmittance from outside and R its reflectance for diffuse light from inside. It is the
model of Mitsuba 3's `roughplastic` (with `nonlinear` off); as α → 0, that of its `plastic`.
"""

from __future__ import annotations

from typing import get_args

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.optics import fresnel, microfacets
from fit_material.shaders.optics.microfacets import Distribution
from fit_material.shaders.optics.quadrature import computed_once, facets_and_rotations, half_disc, legendre, slope_plane
from fit_material.shaders.optics.safe_sqrt import root

_STEEPEST = 4.0  # slopes beyond 4α hold 2e-8 of Beckmann's normals
_GRAZING = 1e-6  # cosine that stands for 0, as in Mitsuba
_TABLE = 64  # cosines over which Mitsuba takes its mean

_OUTSIDE = computed_once(legendre, 16)
_SHARES = computed_once(legendre, 8)
_DISC = computed_once(half_disc, 10, 8)
_SLOPES = computed_once(slope_plane, 16, 12)
# Fewer facets and turns leave 5e-4 of 1 - R, for G1 has a kink where facets turn below the horizon; these leave 2e-4.
_FACETS = {each: computed_once(facets_and_rotations, 48, 32, each) for each in get_args(Distribution)}


def ior(f0: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
    """η = (1+√f)/(1-√f) of the dielectric whose reflectance at normal incidence is f, in (0, 1).

    The derivative at f = 0 is infinite, and counts as 0.
    """
    return fresnel.index_limit(f0)


def f0(eta: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
    """((η-1)/(η+1))², the reflectance at normal incidence; the inverse of `ior` for η >= 1."""
    return ((eta - 1) / (eta + 1)) ** 2


def transmittance(
    mu: Float[Tensor, "*p"], eta: Float[Tensor, ...], alpha: Float[Tensor, ...], distribution: Distribution
) -> Float[Tensor, "*p"]:
    """T(µ), the share of light from outside that passes the rough interface.

        T(µ) = ∫ D_v(h) (1 - F(v·h; η)) G1(t) dω_h,    t = v refracted at h
        [Walter 2007, eq. 21, over the visible normals D_v of Heitz 2018]

    1 - F(µ) in the limit α → 0. Light that is shadowed below the interface is lost, as in Mitsuba, whose table of T by
    1024 facets is up to 4e-4 too high: light passes twice, and a color from its pictures comes out so much too bright.

    Args:
        mu: µ, cosine between the surface normal and the direction outside, in [0, 1].
        eta: η, index of refraction relative to air, >= 1; broadcasts against `mu`.
        alpha: α, microfacet width, > 0; broadcasts against `mu`.

    Returns:
        T, in [0, 1], within 1e-4 of the integral; differentiable in `eta` and `alpha`.
    """
    mu, eta, alpha = (value[..., None] for value in torch.broadcast_tensors(mu.clamp_min(_GRAZING), eta, alpha))
    h_x, h_z, weight = _visible_normals(mu, alpha, distribution)
    cos_d = root((1 - mu) * (1 + mu)) * h_x + mu * h_z
    cos_t = _refracted(cos_d, eta)
    inside = h_z * (cos_t - cos_d / eta) + mu / eta  # -n·t, above 0 for every facet since η >= 1
    passed = fresnel.transmittance(cos_d, eta) * microfacets.smith_g1(inside, alpha, distribution)
    return (weight * passed).sum(-1)


def reflectance(
    mu: Float[Tensor, "*p"], eta: Float[Tensor, ...], alpha: Float[Tensor, ...], distribution: Distribution
) -> Float[Tensor, "*p"]:
    """R(µ), the share of light from outside that the rough interface mirrors.

        R(µ) = ∫ D_v(h) F(v·h; η) G1(l) dω_h,    l = v mirrored at h        [Heitz 2018, eq. 18, integrated]

    F(µ) in the limit α → 0. With T(µ) it is less than 1: shadowed light is lost.

    Args:
        mu, eta, alpha: as of `transmittance`.

    Returns:
        R, in [0, 1].
    """
    mu, eta, alpha = (value[..., None] for value in torch.broadcast_tensors(mu.clamp_min(_GRAZING), eta, alpha))
    h_x, h_z, weight = _visible_normals(mu, alpha, distribution)
    cos_d = root((1 - mu) * (1 + mu)) * h_x + mu * h_z
    mirrored = fresnel.dielectric(cos_d, eta) * microfacets.smith_g1(2 * cos_d * h_z - mu, alpha, distribution)
    return (weight * mirrored).sum(-1)


def _refracted(cos_d: Float[Tensor, "*p"], eta: Float[Tensor, ...]) -> Float[Tensor, "*p"]:
    """Cosine inside, √(η² - 1 + c²)/η: Snell's law in the form that keeps c where η → 1."""
    return root((eta - 1) * (eta + 1) + cos_d**2) / eta


def outcoupling(eta: Float[Tensor, "*p"], alpha: Float[Tensor, ...], distribution: Distribution) -> Float[Tensor, "*p"]:
    """1 / (η² (1 - R)): the body's light, squeezed into the smaller cone inside and scattered until it is out."""
    return 1 / (eta**2 * (1 - internal_reflectance(eta, alpha, distribution)))


def internal_reflectance(
    eta: Float[Tensor, "*p"], alpha: Float[Tensor, ...], distribution: Distribution
) -> Float[Tensor, "*p"]:
    """R as Mitsuba's `roughplastic` computes it, so that its pictures can be met.

    Mitsuba takes twice the plain mean of µR(µ) over 64 even cosines, both ends included. By the trapezoidal rule
    that is (63 R̄ + R(1))/64, R̄ being `diffuse_internal_reflectance`.

    Args:
        eta: η, index of refraction relative to air, >= 1.
        alpha: α, microfacet width, in (0, 1]; broadcasts against `eta`.

    Returns:
        R, in [0, 1). 1 - R is Mitsuba's within 0.15 % for η <= 1.5 and 0.3 % for η <= 2.5, α >= 0.05. Below, Mitsuba's
        64 cosines miss the onset of total reflection, which is 0.5 % (η = 1.9) to 2 % (η = 2.5).
    """
    diffuse = diffuse_internal_reflectance(eta, alpha, distribution)
    return diffuse + (_upright_internal_reflectance(eta, alpha, distribution) - diffuse) / _TABLE


def diffuse_internal_reflectance(
    eta: Float[Tensor, "*p"], alpha: Float[Tensor, ...], distribution: Distribution
) -> Float[Tensor, "*p"]:
    """R̄, the share of diffuse light that the interface throws back when it comes from inside.

        R̄ = 1/π ∫ D(h) ∫ c G1(v) G1(l) F(c) dω_v dω_h,   c = v·h
          = A(1) - A(1 - F)

    A(1) is what white facets would throw back. What passes instead does so outside of the angle of total reflection,
    where Snell's law, c dc = c_o dc_o / η², gives an integral over the smooth F(c_o; η) seen from outside.

    Args:
        eta: η, index of refraction relative to air, >= 1.
        alpha: α, microfacet width, in (0, 1]; broadcasts against `eta`.

    Returns:
        R̄, in [0, 1): 2 ∫ c F dc in the limit α → 0, as in Mitsuba's `plastic`.
    """
    eta, alpha = (value[..., None] for value in torch.broadcast_tensors(eta, alpha))
    outside, weight = (value.to(eta) for value in _OUTSIDE())
    inside = _refracted(outside, eta)
    unmasked = _unmasked(torch.cat([outside.expand_as(inside), inside], -1), alpha, distribution)
    white, passing = unmasked.unflatten(-1, (2, -1)).unbind(-2)
    passed = fresnel.transmittance(outside, eta) / eta**2 * passing
    return (2 * weight * outside * (white - passed)).sum(-1)


def _upright_internal_reflectance(
    eta: Float[Tensor, "*p"], alpha: Float[Tensor, ...], distribution: Distribution
) -> Float[Tensor, "*p"]:
    """R(1) = ∫ D(h) (n·h) F G1(l) dω_h, what comes back of light that meets the interface upright from inside.

    Integrated over the share u of flatter facets: all of them up to those that reflect to the horizon (tan² = 1), less
    what passes those that are flatter than the critical angle (tan² = 1/(η²-1)), at which 1 - F ends like a root.
    """
    eta, alpha = (value[..., None] for value in torch.broadcast_tensors(eta, alpha))
    t, weight = (value.to(eta) for value in _SHARES())
    critical = (eta**2 - 1).clamp_min(1.0).reciprocal()
    ends = _flatter(torch.stack([torch.ones_like(critical), critical]), alpha, distribution)
    share = ends * t * (2 - t)
    squared = share / (1 - share) if distribution == "ggx" else -torch.log1p(-share)
    cos = torch.rsqrt(1 + alpha**2 * squared)
    white, passing = (2 * weight * (1 - t) * ends * microfacets.smith_g1(2 * cos**2 - 1, alpha, distribution)).unbind()
    outside = (1 - eta**2 * (1 - cos[1] ** 2)).clamp_min(_GRAZING).sqrt()
    return (white - passing * fresnel.transmittance(outside, eta)).sum(-1)


def _flatter(
    squared_tan: Float[Tensor, "*p"], alpha: Float[Tensor, ...], distribution: Distribution
) -> Float[Tensor, "*p"]:
    """∫ D(h) (n·h) dω_h over the facets of a lesser tangent."""
    squared = squared_tan / alpha**2
    return squared / (1 + squared) if distribution == "ggx" else -torch.expm1(-squared)


def _unmasked(
    cos_d: Float[Tensor, "*p c"], alpha: Float[Tensor, "*p 1"], distribution: Distribution
) -> Float[Tensor, "*p c"]:
    """Mean of G1(v) G1(l) / (n·h) over microfacets h and mirrored pairs v, l that make the angle `cos_d` with h."""
    squared, turn, weight = (value.to(cos_d) for value in _FACETS[distribution]())
    cos_d, alpha = cos_d[..., None], alpha[..., None]
    h_z = torch.rsqrt(1 + alpha**2 * squared)
    upward = cos_d * h_z
    aside = root((1 - cos_d) * (1 + cos_d)) * (alpha * h_z) * turn
    seen_v, seen_l = microfacets.smith_g1(torch.stack([upward + aside, upward - aside]), alpha, distribution).unbind()
    return (weight / h_z * seen_v * seen_l).sum(-1)


def _visible_normals(
    cos_v: Float[Tensor, "*p 1"], alpha: Float[Tensor, "*p 1"], distribution: Distribution
) -> tuple[Float[Tensor, "*p q"], Float[Tensor, "*p q"], Float[Tensor, "*p q"]]:
    """x and z of microfacet normals, and weights whose sum is 1: a quadrature over D_v(h) = G1 (v·h) D(h) / (n·v).

    v = (√(1-cos_v²), 0, cos_v). The normals stand for their mirror images at -y, too.
    """
    if distribution == "ggx":
        u1, u2, weight = (value.to(cos_v) for value in _DISC())
        h_x, _, h_z = microfacets.sample_visible_normals(cos_v, alpha, u1, u2)
        return h_x, h_z, weight.expand_as(h_x)
    return _visible_beckmann(cos_v, alpha)


def _visible_beckmann(
    cos_v: Float[Tensor, "*p 1"], alpha: Float[Tensor, "*p 1"]
) -> tuple[Float[Tensor, "*p q"], Float[Tensor, "*p q"], Float[Tensor, "*p q"]]:
    """Slopes αx, αy have the density exp(-x²-y²) max(0, cos_v - α sin_v x), up to a factor [Heitz 2014]."""
    along, across, weight = (value.to(cos_v) for value in _SLOPES())
    tilt = alpha * root((1 - cos_v) * (1 + cos_v))
    steepest = cos_v / torch.maximum(tilt, cos_v / _STEEPEST)  # facets beyond face away
    x = along * (steepest + _STEEPEST) - _STEEPEST
    seen = weight * torch.exp(-(x**2)) * (cos_v - tilt * x)
    h_z = torch.rsqrt(1 + alpha**2 * (x**2 + across**2))
    return -alpha * x * h_z, h_z, seen / seen.sum(-1, keepdim=True)
