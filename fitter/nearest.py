"""The known metals that reflect most like the one that was fitted."""

from __future__ import annotations

import torch
from torch import Tensor

from fitter.catalogue import read_catalogue
from fitter.parameters import MetalCoordinates
from fitter.result import Nearest
from fitter.uncertainty import Spread, standard_errors
from shaders import fresnel

COS_D = (1.0, 0.5, 0.25, 0.1)  # 0°, 60°, 76° and 84°: where the curves of metals differ
FLOOR = 2e-3  # of a reflectance; published measurements of one metal differ by more


def nearest_metals(x: Tensor, coordinates: MetalCoordinates, spread: Spread) -> tuple[Nearest, ...]:
    """All metals of the catalogue by their distance in reflectance, nearest first.

    The distance is the root mean square, over three channels and four angles, of the difference in exact
    reflectance over its standard error (at least 0.002): 1 means as far as the fit's own uncertainty.
    """
    cos_d = torch.tensor(COS_D, dtype=torch.float64)[:, None]

    def curve(free: Tensor) -> Tensor:
        metal = coordinates.material(free)
        return fresnel.conductor(cos_d, metal.n, metal.k).flatten()

    fitted, sigma = curve(x), standard_errors(curve, x, spread).clamp_min(FLOOR)

    def distance(n: tuple[float, ...], k: tuple[float, ...]) -> float:
        known = fresnel.conductor(cos_d, *(torch.tensor(v, dtype=torch.float64) for v in (n, k))).flatten()
        return float(((known - fitted) / sigma).square().mean().sqrt())

    found = [Nearest(name=metal.title, distance=distance(metal.n, metal.k)) for metal in read_catalogue()]
    return tuple(sorted(found, key=lambda each: each.distance))
