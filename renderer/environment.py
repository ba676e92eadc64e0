"""The far-away surroundings: radiance by direction, read from file, cleaned, and turned about +Y."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Environment:
    """A latitude-longitude map of radiance, linear Rec. 709, laid out as Mitsuba lays it out.

    The column is u = atan2(x, -z)/2π and the row v = acos(y)/π of the direction (x, y, z) seen in the map's own
    axes, so the centre column looks along +Z and the top row along +Y.

    Attributes:
        radiance: [h, w, 3], float32, finite and >= 0, already multiplied by the scene's `scale`.
        rotation: degrees by which the map is turned about +Y, counter-clockwise seen from above.
        repaired: number of texels that were negative or not finite in the file and were replaced.
    """

    radiance: Float[Tensor, "h w 3"]
    rotation: float = 0.0
    repaired: int = 0
