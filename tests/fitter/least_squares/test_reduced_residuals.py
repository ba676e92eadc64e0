"""Condensed equations against the pixels' own, and where the solver gets from anywhere."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from fit_material.fitter.effects.interreflection import PolishedPixels, Tangent
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.least_squares.noise import even_whitening
from fit_material.fitter.least_squares.reduced_residuals import condensed, solved
from fit_material.fitter.least_squares.residuals import ROBUST_AT, Residuals
from fit_material.fitter.least_squares.solvers import SOLVERS, Solution
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.renderer.path_tracing.differentiable_scene import Radiance
from fit_material.renderer.synthesis.studio import studio
from fit_material.shaders.materials.types import Metal
from tests.fitter.estimation.test_coarse_to_fine import gold, surface_of

SPAN = (0.15, 0.4)


@pytest.fixture(scope="module", params=["direct", "polished"])
def residuals(request) -> Residuals:
    """Gold of alpha 0.25 on 1200 pixels with 1 % of noise, one of them wrong by a factor; by the light table alone, or
    with a tenth as much that paths add, of any slopes."""
    surface, lighting = surface_of(24, 2), Lighting(studio(128), (), PRESETS["preview"])
    model = lighting.pixels(surface, body=False).under(lighting.table(surface, (*SPAN, 5), 256))
    if request.param == "polished":
        direct, generator = model.radiance(gold(0.25)), torch.Generator().manual_seed(4)
        drawn = 0.1 * torch.rand(4, *direct.shape, generator=generator, dtype=torch.float64) * direct
        both = Radiance(*drawn), Radiance(*1.001 * drawn)  # independent halves agree but for their noise
        model = PolishedPixels(model, tuple(Tangent.of(each, gold(0.25)) for each in both))
    picture = model.radiance(gold(0.25))
    noise = torch.randn(picture.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    seen = picture * (1 + 0.01 * noise)
    seen[7] *= 1.5
    coordinates = MetalCoordinates(WidthInterval(*SPAN, logarithmic=True))
    return Residuals(model, coordinates, seen, even_whitening(1 / picture, 0.01))


def anywhere(count: int) -> torch.Tensor:
    """Free vectors from all over the domain: tints to ±1, roughness over the span; and F0 within a third.

    A fit takes its first F0 from a linear equation. From twice the true one, Gauss–Newton would run to F0 = 0, where
    nothing has a slope.
    """
    u = torch.quasirandom.SobolEngine(7, scramble=True, seed=3).draw(count).double()
    reflectivity = torch.logit((gold(0.25).f0 * (2 / 3 + 2 / 3 * u[:, :3])).clamp_max(0.99))
    return torch.cat([reflectivity, 2 * u[:, 3:6] - 1, 4 * u[:, 6:] - 2], 1)


def test_the_sum_of_squares_is_the_pixels_own(residuals):
    """Wherever no pixel is an outlier at either vector; Gram's eigenvalues keep half of float64's digits."""
    truth = residuals.coordinates.free(gold(0.25))
    weighed = residuals.robust_whitening(truth)
    short = condensed(residuals, truth)
    for way in 0.1 * torch.randn(5, 7, generator=torch.Generator().manual_seed(2), dtype=torch.float64):
        x = truth + way
        pixels = torch.einsum("prc,pc->pr", weighed, residuals.difference(x)).square().sum()
        expected = pixels + residuals.prior(x).square().sum()
        assert float(short(x).square().sum()) == pytest.approx(float(expected), rel=1e-7)


def test_its_jacobian_meets_finite_differences(residuals):
    """Central differences of step h err by h²/6 third derivatives and by rounding over h: 1e-8 of the values."""
    x = residuals.coordinates.free(gold(0.25)) + 0.05
    short, step = condensed(residuals, x), 1e-5
    found = short.jacobian(x)
    for i in range(len(x)):
        way = torch.zeros_like(x)
        way[i] = step
        expected = (short(x + way) - short(x - way)) / (2 * step)
        torch.testing.assert_close(found[:, i], expected, atol=1e-6 * float(found.abs().max()), rtol=0)


def test_outliers_weigh_as_hubers_loss_has_it(residuals):
    """Of a table whose halves agree; what they tell where they do not, `test_residuals` has."""
    table = residuals.model.table
    together = replace(table, light=table.light.mean(0).expand_as(table.light))
    residuals = replace(residuals, model=residuals.model.under(together))
    x = residuals.coordinates.free(gold(0.25))
    length = torch.einsum("prc,pc->pr", residuals.whitening, residuals.difference(x)).norm(dim=-1)
    assert length[7] > 3 * ROBUST_AT
    short = condensed(residuals, x)
    slope = short.jacobian(x).T @ short(x)
    expected = torch.func.grad(lambda x: 0.5 * residuals(x).square().sum())(x)
    torch.testing.assert_close(slope, expected, rtol=1e-6, atol=1e-6 * float(expected.abs().max()))


@pytest.mark.slow  # 24 starts, of two models
def test_every_start_leads_to_the_same_metal(residuals):
    """24 starts, spread over the domain, end within a hundredth of an error of each other."""
    truth = residuals.coordinates.free(gold(0.25))
    best = solved(residuals, [truth], SOLVERS["lm"])
    short = condensed(residuals, best.x)
    information = short.jacobian(best.x).T @ short.jacobian(best.x)
    for start in anywhere(24):
        found = solved(residuals, [start, *residuals.coordinates.alternative_starts(start)], SOLVERS["lm"])
        way = found.x - best.x
        assert found.status == "converged"
        assert math.sqrt(float(way @ information @ way)) < 0.01, start
    material = residuals.coordinates.material(best.x)
    assert isinstance(material, Metal)
    torch.testing.assert_close(material.f0, gold(0.25).f0, atol=0.01, rtol=0)


def test_the_deepest_of_several_minima_counts(residuals):
    """A start in which the solver stays where it is put does not keep it from looking elsewhere."""
    truth = residuals.coordinates.free(gold(0.25))
    wrong = torch.cat([truth[:3], torch.full((3,), -1.5, dtype=torch.float64), truth[6:]])

    def lazy(residual, start, tolerance=1e-6):
        if start[3] < -1.2:
            return Solution(start, 0.5 * float(residual(start).square().sum()), "converged", 0, 0.0)
        return SOLVERS["lm"](residual, start, tolerance)

    starts = [wrong, *residuals.coordinates.alternative_starts(wrong)]
    found, best = solved(residuals, starts, lazy), solved(residuals, [truth], SOLVERS["lm"])
    torch.testing.assert_close(found.x, best.x, atol=1e-3, rtol=0)


def test_other_starts_have_the_same_f0_and_roughness(residuals):
    truth = residuals.coordinates.free(gold(0.25))
    others = [residuals.coordinates.material(x) for x in residuals.coordinates.alternative_starts(truth)]
    assert len(others) >= 3
    for metal in others:
        torch.testing.assert_close(metal.f0, gold(0.25).f0)
        assert float(metal.width.value) == pytest.approx(0.25)
        assert (metal.n - gold(0.25).n).abs().max() > 0.02
