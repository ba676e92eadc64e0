"""A gold ball of ninety pixels under a map of five hundred texels, photographed by the fit's own model."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.estimation.model_selection import Choice
from fit_material.fitter.estimation.viewer_roughness import ViewerRoughness
from fit_material.fitter.fitted.determinability import seen_by
from fit_material.fitter.fitted.summary import describe, fitted_material, status_of
from fit_material.fitter.forward.pixel_model import PixelModel, exact_pixels
from fit_material.fitter.least_squares.covariance import sandwich_covariance
from fit_material.fitter.least_squares.noise import even_whitening, relative_weight
from fit_material.fitter.least_squares.residuals import Residuals
from fit_material.fitter.least_squares.solvers import levenberg_marquardt
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.observations.pixel_selection import Observations
from fit_material.fitter.result.schema import FittedMaterial, Status
from fit_material.renderer.environment.environment import Environment, directions
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.light_sampling.integrator import Integration, LobeGrid
from fit_material.renderer.light_tables import light_table
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.shaders.materials.fresnel_models import REFLECTANCES, MaterialReflectance
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet

PIXELS, NOISE = 90, 0.01
SPAN = (0.15, 0.6)  # of alpha
COORDINATES = MetalCoordinates(WidthInterval(*SPAN, logarithmic=True))


def gold() -> Metal:
    """What is photographed."""
    n, k = (torch.tensor(each, dtype=torch.float64) for each in ((0.15, 0.42, 1.43), (3.58, 2.33, 1.85)))
    return Metal(n, k, Microfacet(torch.tensor(0.3, dtype=torch.float64)))


@functools.cache
def surface() -> GBuffer:
    """Pixels of every angle, n·v from 0.06 to 1, in a spiral over the ball's front; one ray each."""
    index = torch.arange(PIXELS, dtype=torch.float64)
    cos, turn = 1 - 0.94 * (index + 0.5) / PIXELS, 2.4 * index  # radians of the golden angle
    radius = ((1 - cos) * (1 + cos)).sqrt()
    origin = torch.stack([radius * torch.cos(turn), radius * torch.sin(turn), torch.full_like(turn, 4.0)], -1)
    towards = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64).expand_as(origin)
    return gbuffer.tracer(Sphere())(origin, towards).reshape(PIXELS, 1)


@functools.cache
def environment() -> Environment:
    """Light of a soft lamp in each colour, over a dim sky."""
    lamps = torch.nn.functional.normalize(
        torch.tensor([[0.3, 0.8, 0.5], [-0.7, 0.1, 0.7], [0.2, -0.5, -0.8]]).double(), dim=1
    )
    cosines = directions(16, 32) @ lamps.T
    return Environment((0.1 + 4 * torch.exp(8 * (cosines - 1)) @ (0.3 + torch.eye(3).double())).float())


@functools.cache
def table(dtype: torch.dtype, device: torch.device) -> LightTable:
    """The ball's light, integrated once in these numbers."""
    light = replace(environment(), radiance=environment().radiance.to(device, dtype))
    return light_table.microfacet_table(
        surface(), light, LobeGrid(*SPAN, 5, "ggx"), Integration(degree=12, samples=128, seed=0)
    )


def model(of: LightTable, reflectance: MaterialReflectance = REFLECTANCES["conductor"]) -> PixelModel:
    """The picture as a function of the material."""
    return exact_pixels(surface(), None, (), "ggx", reflectance).under(of)


def photograph(of: LightTable, noise: float = NOISE, seed: int = 1) -> Float[Tensor, "p 3"]:
    """Gold by that light, with relative noise."""
    picture = model(of).radiance(gold())
    return picture * (1 + noise * torch.randn(picture.shape, generator=torch.Generator().manual_seed(seed)).double())


@dataclass(frozen=True)
class Told:
    """A fit in the words of a result."""

    fit: Fit
    material: FittedMaterial
    status: Status
    message: str


Change = Callable[[Tensor], Tensor]


def residuals_of(
    of: LightTable,
    seen: Float[Tensor, "p 3"],
    pixels: Tensor | None = None,
    reflectance: MaterialReflectance = REFLECTANCES["conductor"],
) -> Residuals:
    """Of a photograph, by all pixels or those named, once or several times."""
    chosen = torch.arange(len(seen)) if pixels is None else pixels
    light = replace(of, light=of.light[:, :, chosen])
    own = exact_pixels(surface()[chosen], None, (), "ggx", reflectance).under(light)
    weight = relative_weight(seen[chosen])
    return Residuals(own, COORDINATES, seen[chosen], even_whitening(weight, NOISE))


def start() -> Float[Tensor, " x"]:
    """A metal of no particular kind."""
    return torch.tensor([1.0, 0.5, 0.0, -0.3, -0.3, -0.3, 0.0], dtype=torch.float64)


def fitted(residuals: Residuals, at: Float[Tensor, " x"] | None = None, steps: int | None = None) -> Fit:
    """Least squares from a start."""
    solution = levenberg_marquardt(residuals, start() if at is None else at, steps=steps)
    return Fit(residuals, solution, solution.x, solution.seconds)


def told(
    residuals: Residuals, pixels: Tensor | None = None, at: Tensor | None = None, steps: int | None = None
) -> Told:
    """A fit with its errors, verdicts and status, as `result.json` would have them."""
    fit = fitted(residuals, at, steps)
    chosen = torch.arange(PIXELS) if pixels is None else pixels
    place = torch.zeros(len(chosen), 3, dtype=torch.long)
    observed = Observations(surface()[chosen], residuals.photograph, 0.0, False, len(chosen), place)
    material = fitted_material("ball", fit, sandwich_covariance(residuals, fit.x), ViewerRoughness(0.8, 0.1), ())
    choice = Choice(fit, {"metal": 0.0})
    return Told(fit, material, status_of([choice], [material]), describe(choice, material, seen_by(fit, observed)))
