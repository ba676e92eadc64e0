"""The known metals that reflect most like the one that was fitted."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.least_squares.covariance import Covariance
from fit_material.fitter.least_squares.jacobian import Function, jacobian
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.result.schema import Nearest
from fit_material.renderer.materials.catalogue import Metal, read_catalogue
from fit_material.shaders.optics import fresnel

COS_D = (1.0, 0.5, 0.25, 0.1)  # 0°, 60°, 76° and 84°: where the curves of metals differ
FLOOR = 2e-3  # of a reflectance: less than this no two photographs of one metal agree by
UNSEEN = 1e3  # of a free number, whose material stays the same beyond ± 30: errors beyond that carry no information


def nearest_metals(
    x: Float[Tensor, " x"], coordinates: MetalCoordinates, spread: Covariance, metals: Sequence[Metal] | None = None
) -> tuple[Nearest, ...]:
    """Metals by their distance in reflectance, nearest first.

        d² = ΔᵀK⁻¹Δ / q,   K = G C Gᵀ + 0.002² 1        [Mahalanobis 1936]

    Δ is the difference in exact reflectance at four angles and three channels, G the curve's Jacobian, C the fit's
    covariance, q its number of unknowns that shape the curve: 1 means as far as the fit's own uncertainty. In the
    viewer's model, which sees nothing but F0, Δ is the difference in F0.

    Args:
        x, coordinates, spread: the fit's free vector, what it stands for, and its covariance.
        metals: to compare with; the catalogue's where left out.
    """
    cos_d = torch.tensor(COS_D if coordinates.tint is None else COS_D[:1], dtype=torch.float64)[:, None]

    def curve(free: Tensor) -> Tensor:
        metal = coordinates.material(free)
        return fresnel.conductor(cos_d, metal.n, metal.k).flatten()

    unknowns = coordinates.shape.stop  # those of n and k
    fitted, covariance = curve(x), covariance_of(curve, x, spread)
    covariance = covariance + FLOOR**2 * torch.eye(len(fitted), dtype=torch.float64)

    def distance(known: Metal) -> float:
        reflectance = fresnel.conductor(cos_d, *(torch.tensor(v, dtype=torch.float64) for v in (known.n, known.k)))
        difference = reflectance.flatten() - fitted
        return float((difference @ torch.linalg.solve(covariance, difference) / unknowns).clamp_min(0).sqrt())

    known_metals = read_catalogue() if metals is None else metals
    found = [Nearest(name=metal.title, distance=distance(metal)) for metal in known_metals]
    return tuple(sorted(found, key=lambda each: each.distance))


def covariance_of(quantity: Function, x: Float[Tensor, " x"], spread: Covariance) -> Float[Tensor, "q q"]:
    """Covariance of `quantity(x)` to first order; free numbers that nothing determines count as `UNSEEN`."""
    sigma = spread.covariance.diagonal().clamp_min(torch.finfo(x.dtype).tiny).sqrt()
    gradient = jacobian(quantity, x) * (UNSEEN / sigma).clamp_max(1)
    return gradient @ spread.covariance @ gradient.T
