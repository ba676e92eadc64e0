"""From linear radiance to a display's code: exposure, a tone curve, sRGB.

GLSL twin: shaders/glsl/tone_mapping.glsl.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

CURVES = ("clamp", "reinhard", "aces")
"""The curves by name; a curve's number in GLSL is its place here."""

REINHARD_WHITE = 4.0  # the exposed luminance that becomes 1
BRIGHTEST = 1e6  # white under every curve, and its square is a float32
_LUMINANCE = (0.2126, 0.7152, 0.0722)  # Rec. 709


def tone_mapped(radiance: Float[Tensor, "*p 3"], exposure: float = 0.0, curve: str = "clamp") -> Float[Tensor, "*p 3"]:
    """Radiance as a display's code values.

    Args:
        radiance: linear Rec. 709, finite, >= 0.
        exposure: in stops; every stop doubles the picture's brightness.
        curve: one of `CURVES`.

    Returns:
        sRGB-encoded colour in [0, 1].
    """
    exposed = (radiance * 2.0**exposure).clamp(max=BRIGHTEST)
    return srgb(_CURVES[curve](exposed).clamp(0, 1))


def clamped(radiance: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """No curve: brighter than white is white, and darker is shown exactly."""
    return radiance


def reinhard(radiance: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """Luminance compressed, hue kept.

    c ← c · (1 + L/W²)/(1 + L),  W = `REINHARD_WHITE`        [Reinhard 2002, eq. 4]
    """
    luminance = (radiance * radiance.new_tensor(_LUMINANCE)).sum(-1, keepdim=True)
    return radiance * (1 + luminance / REINHARD_WHITE**2) / (1 + luminance)


def aces(radiance: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """The film-like curve of ACES, as a fit per channel.

        x (2.51 x + 0.03)/(x (2.43 x + 0.59) + 0.14)        [Narkowicz, ACES Filmic Tone Mapping Curve, 2015]

    Its x is 0.6 times the exposed radiance, which brings its brightness to that of ACES itself (ibid.).
    """
    x = 0.6 * radiance
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


def srgb(linear: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """The code of a linear value in [0, 1]: 12.92 x below 0.0031308, 1.055 x^(1/2.4) - 0.055 above [IEC 61966-2-1]."""
    power = 1.055 * linear.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(linear <= 0.0031308, 12.92 * linear, power)


_CURVES = {"clamp": clamped, "reinhard": reinhard, "aces": aces}
