"""The blur radius ρ with which the viewer's own model comes nearest to the photographs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import minimize_scalar

from fitter.fidelity import BLUR_RANGE
from fitter.parameters import Metal
from fitter.quality import tone_mapped, white_point
from fitter.search import VIEWER_FACE_SIZE
from fitter.selection import Observations
from renderer import cubemap, transport
from renderer.environment import Environment
from shaders import fresnel

PIXELS = 1000  # one number is asked for: its error from so few is far below the two models' difference
COARSE_STEPS = 21
SLOPE_STEP = 0.01


@dataclass(frozen=True)
class ViewerRoughness:
    """ρ and its standard error, from the curvature of the sum of squares and the residuals' scatter."""

    rho: float
    stderr: float


def viewer_roughness(observed: Observations, environment: Environment, metal: Metal) -> ViewerRoughness:
    """Fit ρ with n and k held: 49 taps and Lazányi's reflectance at n·v, as the viewer shades [MODEL.md 3.1, 4].

    The pictures are compared as the viewer shows them, tone-mapped. The blur has no tails and cannot follow a
    microfacet lobe everywhere; in linear radiance a few lamps, in relative error the darkest corners would decide.

    Args:
        observed: pixels of the fit; their central rays are used.
        environment: the light; it is resampled to the viewer's cubemap.
        metal: n and k as exported.
    """
    every = max(1, len(observed.radiance) // PIXELS)
    surface = observed.surface[::every, observed.surface.hit.shape[1] // 2]
    seen = observed.radiance[::every].numpy()
    white = white_point(seen)
    faces = cubemap.from_environment(environment, VIEWER_FACE_SIZE)
    reflected = transport.reflect(surface).float()
    reflectance = fresnel.lazanyi(surface.n_dot_v[:, None], metal.n, metal.k)

    def residual(rho: float) -> Float[np.ndarray, "p 3"]:
        blurred = transport.blur(faces, reflected, torch.tensor(rho)) * reflectance
        return tone_mapped(blurred.numpy(), white) - tone_mapped(seen, white)

    def cost(rho: float) -> float:
        return float((residual(rho) ** 2).sum())

    # The blur of a real map has several minima in ρ; a coarse look finds the valley, Brent's method its bottom.
    low, high = 0.0, BLUR_RANGE[1]
    coarse = np.linspace(low, high, COARSE_STEPS)
    best = int(np.argmin([cost(rho) for rho in coarse]))
    bounds = coarse[max(best - 1, 0)], coarse[min(best + 1, COARSE_STEPS - 1)]
    found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-4})
    rho = float(found.x)  # type: ignore[attr-defined] — which scipy's annotations leave out
    before, after = max(rho - SLOPE_STEP, low), min(rho + SLOPE_STEP, high)
    slope = (residual(after) - residual(before)) / (after - before)
    information, variance = float((slope**2).sum()), cost(rho) / max(1, slope.size - 1)
    return ViewerRoughness(rho, (variance / information) ** 0.5 if information > 0 else float("inf"))
