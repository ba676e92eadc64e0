"""The blur radius ρ with which the viewer's own model comes nearest to the photographs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.pixel_model import central
from fit_material.fitter.least_squares.sample_halves import RESOLVED
from fit_material.fitter.observations.pixel_selection import Observations
from fit_material.fitter.options.fidelity import BLUR_RANGE
from fit_material.renderer.images.display import tone_mapped, white_point
from fit_material.renderer.viewer_model.shading import far_light
from fit_material.renderer.viewer_model.viewer_light import Surroundings
from fit_material.shaders.materials.types import Material
from fit_material.shaders.materials.widths import Blur, blur_like
from fit_material.shaders.shade import Points, shade

PIXELS = 1000
PARTS = 8
WITHIN = 4.0  # factor around the first guess, both ways
COARSE_STEPS = 33
ROUNDING = 2.4e-7  # of a tone-mapped picture from a float32 map


@dataclass(frozen=True)
class ViewerRoughness:
    """ρ and its standard error, from how far it differs between parts of the pixels."""

    rho: float
    stderr: float


def _is_seen(costs: Float[np.ndarray, "r p"]) -> bool:
    """Whether pixels are explained better by some ρ than by others: by more than their scatter, and than rounding.

    Args:
        costs: squared differences by ρ and pixel.
    """
    total, pixels = costs.sum(1), costs.shape[1]
    by_chance = total.min() / max(1, pixels - 1)
    return bool(total.max() - total.min() > RESOLVED**2 * max(by_chance, ROUNDING**2 * pixels))


def viewer_roughness(
    observed: Observations, light: Surroundings, material: Material, tint: Float[Tensor, "p 3"] | None = None
) -> ViewerRoughness:
    """Fit ρ with n and k, or colour and reflectance, held, in the model by which the viewer shades [MODEL.md 3, 4].

    The pictures are compared as the viewer shows them, tone-mapped. The blur has no tails and cannot follow a
    microfacet lobe everywhere; in linear radiance a few lamps, in relative error the darkest corners would decide.

    Args:
        observed: pixels of the fit; their central rays are used.
        light: as the viewer has it.
        material: as exported, its roughness alpha.
        tint: of each pixel, by which the colour is multiplied; None for none.
    """
    every = max(1, len(observed.radiance) // PIXELS)
    surface = central(observed.surface[::every])
    seen = observed.radiance[::every].numpy()
    white = white_point(seen)
    tint = None if tint is None else tint[::every]
    points = Points(surface.normal, surface.view, tint=tint, position=surface.position)
    of_environment = far_light(light)

    def residual(rho: float) -> Float[np.ndarray, "p 3"]:
        picture = shade(material.with_width(Blur(torch.tensor(rho, dtype=torch.float64))), points, of_environment)
        return tone_mapped(picture.numpy(), white) - tone_mapped(seen, white)

    # The blur of a real map has several minima in ρ. A coarse look around the first guess 2√2·alpha finds the valley.
    assert material.width is not None
    guess = float(blur_like(material.width).value)
    coarse = np.geomspace(guess / WITHIN, min(guess * WITHIN, BLUR_RANGE[1]), COARSE_STEPS)
    costs = np.stack([(residual(rho) ** 2).sum(1) for rho in coarse])
    best = int(costs.sum(1).argmin())
    bounds = coarse[max(best - 1, 0)], coarse[min(best + 1, COARSE_STEPS - 1)]
    from scipy.optimize import minimize_scalar  # 0.8 s, for the fit's end alone

    found = minimize_scalar(lambda rho: (residual(rho) ** 2).sum(), bounds=bounds, method="bounded").x  # type: ignore
    if not _is_seen(costs):
        return ViewerRoughness(float(found), math.inf)
    # The two models differ far more than their noise: how far ρ depends on the pixels chosen is its honest error.
    of_parts = [coarse[costs[:, part::PARTS].sum(1).argmin()] for part in range(PARTS)]
    step = float(bounds[1] - bounds[0]) / 2
    return ViewerRoughness(float(found), max(float(np.std(of_parts, ddof=1)) / PARTS**0.5, step / 12**0.5 / PARTS))
