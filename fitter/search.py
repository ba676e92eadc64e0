"""The fit of one metal: light tables, a start that knows nothing, and two rounds of least squares."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fitter.catalogue import read_catalogue
from fitter.fidelity import BLUR_RANGE, MICROFACET_RANGE, Fidelity
from fitter.parameters import Interval, MetalCoordinates, tint_of
from fitter.residuals import REFLECTANCES, PixelModel, Residuals, relative_weight, scatter
from fitter.selection import Observations
from fitter.solve import ROUGH, Solution, Solver
from renderer import cubemap, transport
from renderer.environment import Environment
from renderer.gbuffer import GBuffer
from renderer.surroundings import VIEWER_FACE_SIZE
from renderer.transport import LightTable
from shaders import fresnel
from shaders.materials import Metal

Progress = Callable[[str, float], None]

SEARCH_SCATTER = 0.03  # of the relative difference, while nothing is known of it yet
EXACT = 1e-9  # least scatter, where photographs are noiseless and there is nothing but rounding
MORE_ROUNDS = 3  # where the roughness runs into an end of the last span


@dataclass(frozen=True)
class Fit:
    """A finished fit.

    Attributes:
        metal: what was found.
        x: its free vector.
        residuals: of the last round.
        halves: the same with either half of the light table's samples.
        solution: how the last round's solver ended.
        solve_seconds: time spent in solvers, over all rounds.
    """

    metal: Metal
    x: Float[Tensor, " x"]
    residuals: Residuals
    halves: tuple[Residuals, Residuals]
    solution: Solution
    solve_seconds: float


def fit_metal(
    observed: Observations,
    environment: Environment,
    fidelity: Fidelity,
    solver: Solver,
    *,
    seed: int,
    progress: Progress,
) -> Fit:
    """Fit one metal to the observed pixels.

    A coarse table over all roughnesses serves the search; finer ones around the roughness found serve the rest, the
    last of them laid anew where the roughness leaves it.

    Args:
        observed: the pixels.
        environment: the light.
        fidelity: how accurately.
        solver: least squares.
        seed: of the integration.
        progress: told the stage and its share done.
    """
    whole = BLUR_RANGE if fidelity.lobe == "taps" else MICROFACET_RANGE

    def table_of(span: tuple[float, float], levels: int, samples: int, stage: str) -> LightTable:
        report = functools.partial(progress, stage)
        return light_table(observed.surface, environment, fidelity, (*span, levels), samples, seed, report)

    table = table_of(whole, fidelity.search_levels, fidelity.search_samples, "searching")
    residuals, start = _search_round(table, observed, fidelity)
    solutions = [solver(residuals, residuals.coordinates.free(start), ROUGH)]
    metal = residuals.coordinates.metal(solutions[-1].x)
    spans = [*fidelity.spans, *[fidelity.spans[-1]] * MORE_ROUNDS]
    for done, factor in enumerate(spans, start=1):
        span = _span_around(float(metal.roughness), factor, whole)
        table = table_of(span, fidelity.levels, fidelity.samples, "integrating")
        residuals = _refined_round(table, observed, residuals, metal)
        solutions.append(solver(residuals, residuals.coordinates.free(_inside(metal, residuals.coordinates.roughness))))
        metal = residuals.coordinates.metal(solutions[-1].x)
        if done >= len(fidelity.spans) and not _at_an_end(float(metal.roughness), span, whole):
            break
    halves = (_of_half(residuals, 0), _of_half(residuals, 1))
    return Fit(metal, solutions[-1].x, residuals, halves, solutions[-1], sum(each.seconds for each in solutions))


def _search_round(table: LightTable, observed: Observations, fidelity: Fidelity) -> tuple[Residuals, Metal]:
    """The first problem, and a start for it that knows nothing of the metal."""
    model = PixelModel.of(table, REFLECTANCES[fidelity.reflectance])
    weight = relative_weight(observed.radiance)
    start = coarse_start(model, observed.radiance, weight)
    coordinates = _coordinates(table, fidelity, start)
    start = _inside(start, coordinates.roughness)
    return Residuals(model, coordinates, observed.radiance, weight, SEARCH_SCATTER), start


def _refined_round(table: LightTable, observed: Observations, before: Residuals, metal: Metal) -> Residuals:
    """The next problem, its weights and its scatter taken from the metal found so far.

    Weights come from that metal's picture and not from the photographs: dividing by a noisy value would favour its
    low outcomes and darken the metal by the noise's variance. Only where the lobe is the viewer's, which follows no
    photograph closely, do they stay with the photographs: a picture far off would weigh its own mistakes.
    """
    model = PixelModel.of(table, before.model.reflectance)
    picture = model.radiance(metal)
    weight = before.weight if table.scale == "linear" else relative_weight(picture)
    scattered = scatter((picture - observed.radiance) * weight)
    roughness = replace(before.coordinates.roughness, low=table.low, high=table.high)
    coordinates = replace(before.coordinates, roughness=roughness)
    return Residuals(model, coordinates, observed.radiance, weight, max(scattered, EXACT))


def _of_half(residuals: Residuals, which: int) -> Residuals:
    """The same problem with the table of one half of the samples."""
    return replace(residuals, model=PixelModel.of(residuals.model.table.half(which), residuals.model.reflectance))


def radiance_of(
    metal: Metal, surface: GBuffer, environment: Environment, fidelity: Fidelity, *, samples: int, seed: int
) -> Float[Tensor, "p 3"]:
    """The radiance of one metal, float64, by a table that holds its roughness alone."""
    roughness = float(metal.roughness)
    span = (roughness * 0.999, roughness * 1.001, 1)  # the one level lies in their middle
    table = light_table(surface, environment, fidelity, span, samples, seed)
    return PixelModel.of(table, REFLECTANCES[fidelity.reflectance]).radiance(metal)


def coarse_start(model: PixelModel, photograph: Float[Tensor, "p 3"], weight: Float[Tensor, "p 3"]) -> Metal:
    """The best of the table's own roughnesses for a metal of flat reflectance, whose F0 is then a linear fit.

        F0 = Σ w² m y / Σ w² m²,   m the picture of a perfect mirror of that roughness

    Returns:
        that roughness, that F0 within [0.05, 0.95], and n = 1, the middle of what F0 admits: no metal in particular.
    """
    mirror = model.light[:, :, 0]  # the first Chebyshev polynomial is 1: light under F = 1
    product, square = (weight**2 * mirror * photograph).sum(1), (weight**2 * mirror**2).sum(1)
    f0 = (product / square.clamp_min(torch.finfo(square.dtype).tiny)).clamp(0.05, 0.95)
    error = ((f0[:, None] * mirror - photograph) * weight).abs().mean((1, 2))
    best = int(error.argmin())
    levels = transport.levels(model.table.low, model.table.high, len(error), model.table.scale)
    n = torch.ones_like(f0[best])
    return Metal(n, fresnel.extinction(f0[best], n), torch.tensor(levels[best], dtype=torch.float64))


def _coordinates(table: LightTable, fidelity: Fidelity, start: Metal) -> MetalCoordinates:
    roughness = Interval(table.low, table.high, table.scale == "log")
    if fidelity.reflectance == "conductor":
        return MetalCoordinates(roughness)
    # Lazányi's reflectance sees F0 alone: n and k are taken from the catalogue's metal with the nearest colour.
    known = [(torch.tensor(m.n, dtype=torch.float64), torch.tensor(m.k, dtype=torch.float64)) for m in read_catalogue()]
    distance = [float((fresnel.normal_reflectance(n, k) - start.f0).norm()) for n, k in known]
    return MetalCoordinates(roughness, tint_of(*known[min(range(len(known)), key=distance.__getitem__)]))


def light_table(
    surface: GBuffer,
    environment: Environment,
    fidelity: Fidelity,
    levels: tuple[float, float, int],
    samples: int,
    seed: int,
    progress: Callable[[float], None] = lambda share: None,
) -> LightTable:
    """The table of a fidelity's lobe; `levels` are the ends of its roughness and their number."""
    if fidelity.lobe == "taps":
        on_cpu = replace(environment, radiance=environment.radiance.cpu())  # 49 taps are not worth the way
        faces = cubemap.from_environment(on_cpu, VIEWER_FACE_SIZE)
        return transport.tap_table(surface, faces, levels, degree=fidelity.degree)
    return transport.microfacet_table(
        surface,
        environment,
        levels,
        distribution=fidelity.lobe,
        degree=fidelity.degree,
        samples=samples,
        seed=seed,
        progress=progress,
    )


def _span_around(roughness: float, factor: float, whole: tuple[float, float]) -> tuple[float, float]:
    """From roughness/factor to roughness·factor, moved inside the whole range."""
    low, high = whole
    centre = min(max(roughness, low * factor), high / factor)
    return centre / factor, centre * factor


def _inside(metal: Metal, roughness: Interval) -> Metal:
    """The metal with its roughness moved off the ends of its interval, where the free vector would be infinite."""
    margin = 1e-3 * (roughness.high - roughness.low)
    return replace(metal, roughness=metal.roughness.clamp(roughness.low + margin, roughness.high - margin))


def _at_an_end(roughness: float, span: tuple[float, float], whole: tuple[float, float]) -> bool:
    """Whether the roughness ran into an end of its span, in the outer twentieth, that is no end of the whole range."""
    low, high = span
    margin = 0.05 * (high - low)
    at_low = roughness < low + margin and low > whole[0] * 1.01
    at_high = roughness > high - margin and high < whole[1] / 1.01
    return at_low or at_high
