"""The far-away surroundings: radiance by direction, rotated about +Y."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Environment:
    """A latitude-longitude map of radiance, linear Rec. 709, laid out as Mitsuba lays it out.

    The column is u = atan2(x, -z)/2π and the row v = acos(y)/π of the direction (x, y, z) seen in the map's
    own axes, so the centre column looks along +Z and the top row along +Y.

    Attributes:
        radiance: [h, w, 3], float32, finite and >= 0, already multiplied by the scene's `scale`.
        rotation: degrees by which the map is rotated about +Y, counter-clockwise seen from above.
        repaired: number of texels that were negative or not finite in the file and were replaced.
    """

    radiance: Float[Tensor, "h w 3"]
    rotation: float = 0.0
    repaired: int = 0


def directions(height: int, width: int) -> Float[Tensor, "h w 3"]:
    """Unit directions of a map's texels in the map's own axes, float64.

    Column i lies at u = (i + ½)/w and row j at v = j/(h - 1): the first row is +Y itself and the last -Y, as
    in Mitsuba's `envmap`. The only row of a map of height 1 lies on the horizon.
    """
    u = (torch.arange(width, dtype=torch.float64) + 0.5) / width
    v = torch.linspace(0, 1, height, dtype=torch.float64) if height > 1 else torch.tensor([0.5]).double()
    theta, phi = torch.meshgrid(math.pi * v, 2 * math.pi * u, indexing="ij")
    return torch.stack([theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos()], -1)
