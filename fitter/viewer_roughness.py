"""The blur radius ρ with which the viewer's own model comes nearest to the photographs."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.optimize import minimize_scalar

from fitter.fidelity import BLUR_RANGE
from fitter.parameters import Metal
from fitter.residuals import pseudo_huber, relative_weight
from fitter.search import SEARCH_THRESHOLD, VIEWER_FACE_SIZE
from fitter.selection import Observations
from renderer import cubemap, transport
from renderer.environment import Environment
from shaders import fresnel

PIXELS = 1000  # one number is asked for: its error from so few is far below the two models' difference


@dataclass(frozen=True)
class ViewerRoughness:
    """ρ and its standard error, from the curvature of the sum of squares and the residuals' scatter."""

    rho: float
    stderr: float


def viewer_roughness(observed: Observations, environment: Environment, metal: Metal) -> ViewerRoughness:
    """Fit ρ with n and k held: 49 taps and Lazányi's reflectance at n·v, as the viewer shades [MODEL.md 3.1, 4].

    Args:
        observed: pixels of the fit; their central rays are used.
        environment: the light; it is resampled to the viewer's cubemap.
        metal: n and k as exported.
    """
    every = max(1, len(observed.radiance) // PIXELS)
    surface = observed.surface[::every, observed.surface.hit.shape[1] // 2]
    seen = observed.radiance[::every]
    weight = relative_weight(seen)
    faces = cubemap.from_environment(environment, VIEWER_FACE_SIZE)
    reflected = transport.reflect(surface).float()
    reflectance = fresnel.lazanyi(surface.n_dot_v[:, None], metal.n, metal.k)

    def residual(rho: float) -> torch.Tensor:
        blurred = transport.blur(faces, reflected, torch.tensor(rho))
        return pseudo_huber((blurred * reflectance - seen) * weight, SEARCH_THRESHOLD)

    def cost(rho: float) -> float:
        return float((residual(rho) ** 2).sum())

    # The blur of a real map has several minima in ρ; a coarse look finds the valley, Brent's method its bottom.
    low, high = BLUR_RANGE
    coarse = torch.linspace(low, high, 33).tolist()
    best = min(range(len(coarse)), key=[cost(rho) for rho in coarse].__getitem__)
    bounds = (coarse[max(best - 1, 0)], coarse[min(best + 1, len(coarse) - 1)])
    rho = float(minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-4}).x)
    step = 1e-2
    slope = (residual(min(rho + step, high)) - residual(max(rho - step, low))) / (
        min(rho + step, high) - max(rho - step, low)
    )
    information = float((slope**2).sum())
    variance = cost(rho) / max(1, 3 * len(seen) - 1)
    return ViewerRoughness(rho, (variance / information) ** 0.5 if information > 0 else float("inf"))
