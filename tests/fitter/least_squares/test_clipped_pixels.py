"""Clipped pixels, of which photographs tell no more than that they are white at least."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image as PillowImage
from scipy.optimize import least_squares

from fit_material.fitter.estimation.coarse_to_fine import _whitening
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.least_squares.noise import even_whitening, local_whitening, neighbours_of, relative_weight
from fit_material.fitter.least_squares.reduced_residuals import solved
from fit_material.fitter.least_squares.residuals import LIFTED, Residuals
from fit_material.fitter.least_squares.solvers import SOLVERS
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.observations.photograph import Photograph, read_photograph
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import BOUNDS, choose_pixels
from fit_material.fitter.options.fidelity import PRESETS, preset
from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.synthesis.studio import studio
from tests.fitter.estimation.test_coarse_to_fine import gold, problem_of, surface_of
from tests.fitter.observations.test_pixel_selection import photograph
from tests.renderer.photographs.test_exposure import spec
from tests.renderer.rays.test_self_visibility import bowl
from tests.support.modelled import Modelled, written
from tests.support.srgb_curve import encoded

pytestmark = pytest.mark.fits

SIZE = 9


def picture(folder: Path, pixels: dict[tuple[int, int], tuple[int, int, int]], **table) -> Photograph:
    """Of mid-grey codes but for some pixels."""
    codes = np.full((SIZE, SIZE, 3), 128, np.uint8)
    for place, colour in pixels.items():
        codes[place] = colour
    PillowImage.fromarray(codes).save(folder / "a.png")
    return read_photograph(spec(folder, image="a.png", **table), "scene.toml")


def test_a_clipped_channel_is_white_at_least_and_of_the_others_nothing_is_known(tmp_path):
    """White is 253.5 of 255; its neighbours are left out, too, but they are not clipped, and nothing bounds them."""
    found = picture(tmp_path, {(2, 3): (255, 90, 254), (6, 6): (253, 0, 0)}, encoding="linear", exposure=0.5)
    bounds = found.of_bounds
    assert bounds is not None
    assert bounds.mask.nonzero().tolist() == [[2, 3]]
    white = 253.5 / 255 / 0.5
    torch.testing.assert_close(bounds.radiance[2, 3], torch.tensor([white, 0, white]))
    assert not found.mask[2, 3]


def test_white_is_balanced_with_what_it_bounds(tmp_path):
    gains = (2.0, 1.0, 0.5)
    bounds = picture(tmp_path, {(4, 4): (255, 255, 255)}, white_balance=gains).of_bounds
    assert bounds is not None
    white = ((253.5 / 255 + 0.055) / 1.055) ** 2.4  # [IEC 61966-2-1]
    torch.testing.assert_close(bounds.radiance[4, 4], white / torch.tensor(gains))


def test_the_shortest_exposure_bounds_what_all_clip(tmp_path):
    """A light that is too bright for both, and one that only the longer one clips."""
    for name, time in (("long.png", 1.0), ("short.png", 0.25)):
        seen = np.full((SIZE, SIZE, 3), 0.1)
        seen[4, 4], seen[1, 1] = 50.0, 2.0
        PillowImage.fromarray(np.rint(255 * np.clip(seen * time, 0, 1)).astype(np.uint8)).save(tmp_path / name)
    table = {"images": ["long.png", "short.png"], "exposure": [1.0, 0.25], "encoding": "linear"}
    bounds = read_photograph(spec(tmp_path, **table), "scene.toml").of_bounds
    assert bounds is not None
    assert bounds.mask.nonzero().tolist() == [[4, 4]]
    torch.testing.assert_close(bounds.radiance[4, 4], torch.full((3,), 253.5 / 255 / 0.25))


def test_floats_and_what_is_not_masked_in_bound_nothing(tmp_path):
    assert photograph().of_bounds is None
    white = np.zeros((SIZE, SIZE), np.uint8)
    white[:5] = 255
    PillowImage.fromarray(white).save(tmp_path / "mask.png")
    assert picture(tmp_path, {(7, 7): (255, 255, 255)}, mask="mask.png").of_bounds is None


def clipped(size: int, share: float) -> Photograph:
    """A photograph of which so many pixels by chance are clipped."""
    whole = photograph(size=size)
    full = torch.rand(size, size, generator=torch.Generator().manual_seed(8)) < share
    radiance = torch.where(full[..., None], 2.0, whole.radiance)
    return replace(whole, radiance=radiance, mask=~full, full=full, white=torch.ones(3), clipped=int(full.sum()))


def test_bounds_come_on_top_of_the_pixels_that_are_wanted():
    seen, count = [clipped(96, 0.3), photograph(), clipped(96, 0.1)], 600
    trace = gbuffer.tracer(Sphere())
    (found,) = choose_pixels(PixelRequest(seen, trace, Path("scene.toml"), 2, seed=0), count)
    assert found is not None
    assert found.bounded is not None
    assert len(found.measured.radiance) == count
    assert found.measured.bounded is None
    of_photograph = torch.bincount(found.place[found.bounded, 0], minlength=3)
    assert of_photograph.tolist() == [count // 3 // BOUNDS, 0, count // 3 // BOUNDS]
    assert (found.place[:, 0].diff() >= 0).all()  # those of one photograph are next to each other
    for index, each in enumerate(seen):
        own = found.place[:, 0] == index
        row, column = found.place[own, 1:].T
        assert torch.equal(each.mask[row, column], ~found.bounded[own])
    assert found.radiance[found.bounded].unique().tolist() == [1.0]
    assert found.surface.front.all()


def test_no_bound_is_taken_where_the_object_mirrors_itself():
    """Of the bowl's inside no pixel is free of that; measured ones are taken nevertheless, the least of them."""
    inside = replace(clipped(96, 0.3), camera=photograph((0.0, 4.0, 0.1)).camera)
    (found,) = choose_pixels(PixelRequest([inside], gbuffer.tracer(bowl()), Path("scene.toml"), 1, seed=0), 64)
    assert found is not None
    assert found.bounded is None


SPAN = (0.15, 0.4)
NOISE = 0.01


@pytest.fixture(scope="module")
def residuals() -> Residuals:
    """Gold of alpha 0.25 with 1 % of noise; every third pixel is a bound, half of what it is but for 40 where bound and
    picture contradict the rest by a tenth."""
    surface, lighting = surface_of(24, 2), Lighting(studio(128), (), PRESETS["preview"])
    table = lighting.table(surface, (*SPAN, 5), 256)
    alike = replace(table, light=table.light.mean(0, keepdim=True).expand_as(table.light))  # no light counts for less
    model = lighting.pixels(surface, body=False).under(alike)
    shown = model.radiance(gold(0.25))
    noise = torch.randn(shown.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    seen = shown * (1 + NOISE * noise)
    bounded = torch.arange(len(seen)) % 3 == 0
    seen[bounded] *= 0.5
    seen[:120:3] *= 2.2
    coordinates = MetalCoordinates(WidthInterval(*SPAN, logarithmic=True))
    return Residuals(model, coordinates, seen, even_whitening(1 / shown, NOISE), bounded=bounded)


def test_what_is_bright_enough_differs_by_nothing(residuals):
    x = residuals.coordinates.free(gold(0.25))
    found, plain = residuals.difference(x), residuals.picture(x) - residuals.photograph
    bounded = residuals.bounded
    assert torch.equal(found[~bounded], plain[~bounded])
    missing = -found[:120:3] / residuals.picture(x)[:120:3]
    # a tenth and its own noise are missing, of which noise may have lifted 2 σ
    torch.testing.assert_close(missing, torch.full_like(missing, 0.1 - LIFTED * NOISE), atol=1.1 * 5 * NOISE, rtol=0)
    assert not found[120:][bounded[120:]].any()


def test_the_weights_have_the_losss_slope(residuals):
    """Of Σψψ' against WᵀW r, as where nothing is bounded."""
    x = residuals.coordinates.free(gold(0.25)) + 0.01
    slope = torch.func.grad(lambda x: 0.5 * residuals.whitened(x).square().sum())(x)
    whitening = residuals.robust_whitening(x)
    jacobian, left = whitening @ residuals.slope(x), torch.einsum("prc,pc->pr", whitening, residuals.difference(x))
    found = torch.einsum("prx,pr->x", jacobian, left)
    torch.testing.assert_close(found, slope, atol=1e-9 * float(slope.abs().max()), rtol=0)


def test_condensed_bounds_lead_where_scipy_finds_the_least_squares(residuals):
    """Least squares of the whole vector by another program, and by condensed equations whose bounds are switched on and
    off between solutions; both to a hundredth of a standard error, which is about 1e-3 of a free number here."""
    start = residuals.coordinates.free(gold(0.25)) + 0.05
    found = solved(residuals, [start], SOLVERS["lm"]).x

    def vector(x: np.ndarray) -> np.ndarray:
        return residuals(torch.from_numpy(x)).numpy()

    def slope(x: np.ndarray) -> np.ndarray:
        return torch.func.jacfwd(residuals)(torch.from_numpy(x)).numpy()

    expected = least_squares(vector, start.numpy(), slope, xtol=1e-12, ftol=1e-12)  # type: ignore[arg-type]
    covariance = np.linalg.inv(expected.jac.T @ expected.jac)
    error = found.numpy() - expected.x
    assert math.sqrt(error @ np.linalg.solve(covariance, error)) < 0.01
    without = replace(residuals, photograph=residuals.photograph.clone())
    without.photograph[:120:3] /= 2.2
    moved = solved(without, [start], SOLVERS["lm"]).x - found
    assert math.sqrt(moved @ torch.from_numpy(np.linalg.inv(covariance)) @ moved) > 5  # or bounds would be in vain


def test_bounds_that_are_kept_change_nothing(residuals):
    """As without these pixels: to rounding, for their weights are 0."""
    seen = residuals.photograph.clone()
    seen[:120:3] /= 2.2
    kept = replace(residuals, photograph=seen)
    gone = residuals.whitening * (~residuals.bounded)[:, None, None]
    start = residuals.coordinates.free(gold(0.25)) + 0.05
    found = solved(kept, [start], SOLVERS["lm"]).x
    expected = solved(replace(residuals, photograph=seen, whitening=gone, bounded=None), [start], SOLVERS["lm"]).x
    torch.testing.assert_close(found, expected, atol=1e-6, rtol=0)


def test_a_bounds_noise_is_its_measured_neighbours():
    """Of a noise alike in all channels, the others of whose pixels would say nearly all of one: a bound asks each of
    its own. 32 neighbours know a standard deviation to 1/8."""
    surface = surface_of(48)[:, 0]
    count = len(surface.hit)
    bounded = torch.arange(count) % 5 == 0
    shown = torch.ones(count, 3, dtype=torch.float64)
    generator = torch.Generator().manual_seed(0)
    noise = 0.02 * torch.randn(count, 1, generator=generator, dtype=torch.float64) * torch.ones(3).double()
    noise[bounded] = -1.0  # twice as bright as the picture, were it no bound
    found = local_whitening(noise, shown, neighbours_of(surface, left_out=bounded), 1e-6, bounded)[bounded]
    assert torch.equal(found, torch.diag_embed(found.diagonal(dim1=1, dim2=2)))
    sigma = 1 / found.diagonal(dim1=1, dim2=2)
    assert float((sigma / (2 * 0.02)).log().abs().max()) < 5 / 8
    assert float(sigma.mean()) == pytest.approx(0.04, rel=0.05)


def test_bounds_tell_no_noise_to_the_viewers_lobe():
    """It weighs all pixels by one scatter, their median; here nearly half of them would double that."""
    problem = problem_of(gold(0.3), surface_of(24), studio(64), preset("preview", "gaussian"))
    seen = problem.observed.radiance
    bounded = torch.arange(len(seen)) % 9 < 4
    noise = torch.randn(seen.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    picture = torch.where(bounded[:, None], 10 * seen, seen * (1 + 0.02 * noise))
    problem = replace(problem, observed=replace(problem.observed, bounded=bounded))
    sigma = 1 / (_whitening(problem, picture, seen).diagonal(dim1=1, dim2=2) / relative_weight(seen))
    own = np.abs(((picture - seen) * relative_weight(seen)).numpy()[~bounded.numpy()])
    # of an even count torch's median is the lower middle value, numpy's the mean of both: 1/N apart, N over 1000
    torch.testing.assert_close(sigma, torch.full_like(sigma, 1.4826 * np.median(own)), rtol=5e-3, atol=0)


@pytest.mark.slow
def test_a_metal_whose_highlights_are_clipped_is_found(tmp_path):
    """8 bits, sRGB, a twentieth of the ball clipped; a code's rounding is 0.5 % of middling values, and F0's figure of
    0.02 is that of noisy ones."""
    gold_ball = Modelled({"gold": gold(0.3)}, studio(64).radiance.numpy(), azimuths=(0.0, 120.0), size=48)
    scene = written(gold_ball, tmp_path)
    text = scene.read_text()
    for azimuth in gold_ball.azimuths:
        image = read_image(tmp_path / f"view_{azimuth:g}.exr")
        covered = np.asarray(image.alpha) > 0.999
        white = np.quantile(image.radiance[covered].max(-1), 0.95)
        codes = np.rint(255 * encoded(np.clip(image.radiance / white, 0, 1))).astype(np.uint8)
        alpha = np.where(covered, 255, 0).astype(np.uint8)[..., None]
        PillowImage.fromarray(np.concatenate([codes, alpha], -1)).save(tmp_path / f"view_{azimuth:g}.png")
        text = text.replace(f'"view_{azimuth:g}.exr"', f'"view_{azimuth:g}.png"\nexposure = {1 / white}')
    scene.write_text(text)
    result = fit_scene(scene, tmp_path / "fit", FitOptions(PRESETS["preview"], type="metal"))
    assert "or beside such, were not fitted; of " in result.message
    found = json.loads((tmp_path / "fit" / "result.json").read_text())["materials"][0]
    np.testing.assert_allclose(found["f0"], gold(0.3).f0, atol=0.02)
