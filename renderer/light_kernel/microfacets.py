"""Microfacet lobes inside a Dr.Jit kernel: what `shaders.optics.blur` computes in torch.

Half vectors are given by their components, and sin² from the horizontal ones: in float32 that keeps lobes as narrow as
α = 10⁻³, whose cosines all but round to 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
from drjit.llvm import Array3f

from fit_material.shaders.optics.microfacets import Distribution


@dataclass(frozen=True)
class View:
    """The direction to the viewer, (sin_v, 0, cos_v), in the frame whose z is the normal."""

    sin: Any
    cos: Any


def sample_visible_normals(view: View, alpha: Any, radius: Any, sin: Any, cos: Any) -> Array3f:
    """GGX microfacet normals in proportion to the area that the viewer sees of them [Heitz 2018, listing 1].

    Args:
        alpha: α, microfacet width, > 0.
        radius, sin, cos: √u1, and sine and cosine of the azimuth 2πu2.
    """
    stretched = dr.normalize(Array3f(alpha * view.sin, 0, view.cos))
    t1 = radius * cos
    s = 0.5 * (1 + stretched.z)
    t2 = dr.lerp(dr.safe_sqrt(1 - t1 * t1), radius * sin, s)
    t3 = dr.safe_sqrt(1 - t1 * t1 - t2 * t2)
    x = t3 * stretched.x - t2 * stretched.z
    z = t2 * stretched.x + t3 * stretched.z
    return dr.normalize(Array3f(alpha * x, alpha * t1, dr.maximum(z, 0)))


def visible_normal_density(view: View, h: Array3f, alpha: Any) -> Any:
    """Density per steradian of the view mirrored by such normals, G1(v) D(h) / (4 n·v) [Heitz 2018]."""
    return alpha * alpha / (2 * math.pi * _ggx_spread(h, alpha) * _ggx_masking(view.sin, view.cos, alpha))


def reflected(view: View, cos_l: Any, h: Array3f, alpha: Any, distribution: Distribution) -> Any:
    """BRDF · n·l without the reflectance F: D(h) G1(v) G1(l) / (4 n·v) [Walter 2007, eq. 20, 23].

    Args:
        cos_l: n·l, > 0; the value for light from below the horizon is meaningless.
    """
    sin_l = dr.safe_sqrt((1 - cos_l) * (1 + cos_l))
    if distribution == "ggx":
        masking = _ggx_masking(view.sin, view.cos, alpha) * _ggx_masking(sin_l, cos_l, alpha)
        return alpha * alpha * cos_l / (math.pi * _ggx_spread(h, alpha) * masking)
    unmasked = _beckmann_g1(view.sin, view.cos, alpha) * _beckmann_g1(sin_l, cos_l, alpha)
    return _beckmann(h, alpha) * unmasked / (4 * view.cos)


def _ggx_spread(h: Array3f, alpha: Any) -> Any:
    """[cos²(α² + tan²)]² of the half vector: α²/π over it is D [Walter 2007, eq. 33]."""
    return dr.square(dr.square(alpha * h.z) + h.x * h.x + h.y * h.y)


def _ggx_masking(sin: Any, cos: Any, alpha: Any) -> Any:
    """cos + √(cos² + α² sin²): 2 cos over it is G1 [Walter 2007, eq. 34]."""
    return cos + dr.sqrt(cos * cos + dr.square(alpha * sin))


def _beckmann(h: Array3f, alpha: Any) -> Any:
    """D of Beckmann's normals [Walter 2007, eq. 25]."""
    cos2 = dr.maximum(h.z * h.z, 1e-12)  # of the horizon itself: keeps tan² finite, D is 0 far before
    slope2 = (h.x * h.x + h.y * h.y) / (cos2 * alpha * alpha)
    return dr.exp(-slope2) / (math.pi * dr.square(alpha * cos2))


def _beckmann_g1(sin: Any, cos: Any, alpha: Any) -> Any:
    """Smith's G1 in its rational form [Walter 2007, after eq. 27]."""
    a = dr.minimum(cos / dr.maximum(alpha * sin, 1e-12), 1.6)
    rational = a * (3.535 + 2.181 * a) / (1 + a * (2.276 + 2.577 * a))
    return dr.select(a < 1.6, rational, 1)
