"""The light around a model, in the forms in which the viewer's model takes it: cubemap, ambient light, sources."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.environment import cubemap
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.scene.lights import LightSpec, light_of
from fit_material.shaders.lights import Light
from fit_material.shaders.optics import diffuse

VIEWER_FACE_SIZE = 256  # texels along a cubemap face: the resolution of a 1k map
_AZIMUTHS = 8  # that many equidistant points integrate products of two polynomials of degree 2 in the azimuth exactly
_GAUSS_POINTS = 16


@dataclass(frozen=True)
class Surroundings:
    """The light around a model.

    Attributes:
        cubemap: radiance of the far environment, faces [6, n, n, 3], float32.
        ambient: coefficients of `diffuse.ambient`, float64.
        sources: lights beside the environment, float64.
    """

    cubemap: Cubemap
    ambient: Float[Tensor, "9 3"]
    sources: tuple[Light, ...] = ()


def surroundings(
    environment: Environment,
    lights: Sequence[LightSpec] = (),
    ambient: tuple[float, float, float] | None = None,
    size: int = VIEWER_FACE_SIZE,
) -> Surroundings:
    """The light of an environment and of lights beside it.

    Args:
        environment: the far surroundings.
        lights: of the scene file.
        ambient: radiance of ambient light that is the same from everywhere; the environment's irradiance over π
            where left out [MODEL.md 4].
        size: texels along a face of the cubemap.
    """
    if ambient is None:
        coefficients = diffuse.ambient_coefficients(harmonic_moments(environment))
    else:
        coefficients = diffuse.constant_ambient(torch.tensor(ambient, dtype=torch.float64))
    faces = cubemap.from_environment(environment, size)
    return Surroundings(faces, coefficients, tuple(light_of(light) for light in lights))


def harmonic_moments(environment: Environment) -> Float[Tensor, "9 3"]:
    """∫ L(ω) h_i(ω) dω over the sphere, h the `diffuse.harmonics`, L the map under bilinear lookup; float64.

    Exact to rounding: the harmonics are polynomials of degree 2 in the azimuth, so that a row counts by its Fourier
    coefficients of that degree alone; between two rows everything is smooth, and Gauss's rule integrates it.
    """
    azimuths = torch.arange(_AZIMUTHS, dtype=torch.float64) * (2 * math.pi / _AZIMUTHS)
    rows = _band_limited(environment, azimuths)
    polar, weights, upper = _polar_quadrature(len(rows))
    lower = upper.ceil().long()
    share = (upper - upper.floor())[:, None, None]
    between = (1 - share) * rows[upper.long()] + share * rows[lower]
    sin, cos = polar.sin()[:, None], polar.cos()[:, None]
    towards = torch.stack([sin * azimuths.sin(), cos.expand(-1, _AZIMUTHS), -sin * azimuths.cos()], -1)
    solid_angle = weights * polar.sin() * (2 * math.pi / _AZIMUTHS)
    return torch.einsum("t,tai,tac->ic", solid_angle, diffuse.harmonics(towards), between)


def _band_limited(environment: Environment, azimuths: Float[Tensor, " a"]) -> Float[Tensor, "h a 3"]:
    """The map's rows, linear between texels, without degrees above 2 in the azimuth; in world axes.

    The tent over a texel has the Fourier coefficients sinc²(m/w).
    """
    width = environment.radiance.shape[1]
    texels = 2 * math.pi * ((torch.arange(width, dtype=torch.float64) + 0.5) / width - environment.rotation / 360)
    apart = azimuths - texels[:, None]
    tents = [2 * float(np.sinc(m / width)) ** 2 * torch.cos(m * apart) for m in (1, 2)]
    return torch.einsum("hwc,wa->hac", environment.radiance.double().cpu(), (1 + sum(tents)) / width)


def _polar_quadrature(height: int) -> tuple[Float[Tensor, " t"], Float[Tensor, " t"], Float[Tensor, " t"]]:
    """Gauss's points between the rows of a map: polar angle, weight, and position in rows."""
    x, w = (torch.from_numpy(values) for values in np.polynomial.legendre.leggauss(_GAUSS_POINTS))
    intervals = max(1, height - 1)
    position = (torch.arange(intervals)[:, None] + (x + 1) / 2).flatten()
    step = math.pi / intervals
    return position * step, (w * step / 2).repeat(intervals), position if height > 1 else position * 0
