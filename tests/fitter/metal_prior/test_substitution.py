"""The catalogue as a prior: against closed forms, published measurements it was not made of, and pictures."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
import torch

from fit_material.fitter.estimation.coarse_to_fine import Fit, fit_material
from fit_material.fitter.estimation.model_selection import Choice
from fit_material.fitter.estimation.viewer_roughness import ViewerRoughness
from fit_material.fitter.fitted.determinability import seen_by
from fit_material.fitter.fitted.summary import describe, fitted_material
from fit_material.fitter.least_squares.covariance import Covariance, sandwich_covariance
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import TINT_WIDTH, MetalCoordinates
from fit_material.fitter.metal_prior.borrowed import Borrowed, TooFar
from fit_material.fitter.metal_prior.catalogue_distribution import published_covariance, shape_of
from fit_material.fitter.metal_prior.likelihood import InPictures, InReflectance, likelihood
from fit_material.fitter.metal_prior.mixture_posterior import catalogue_prior
from fit_material.fitter.metal_prior.substitution import borrow, from_prior, with_prior
from fit_material.fitter.options.fidelity import PRESETS, preset
from fit_material.fitter.uncertainty.estimates import Measured
from fit_material.renderer.materials.catalogue import Metal, metal, read_catalogue
from fit_material.renderer.synthesis.studio import studio
from fit_material.shaders.materials import types as shading
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.optics import fresnel
from tests.fitter.estimation.test_coarse_to_fine import problem_of, surface_of

RANGE = WidthInterval(0.02, 1.0, logarithmic=True)
EXACT, VIEWERS = MetalCoordinates(RANGE), MetalCoordinates(RANGE, torch.zeros(3, dtype=torch.float64))
WIDE = 1.4  # of a tint that nothing determines: nearly `TINT_WIDTH`, which the fit holds


def float64(values) -> torch.Tensor:
    return torch.as_tensor(values, dtype=torch.float64)


def posterior(shape: torch.Tensor, sigma_f0: float, sigma_tint=None, metals=None, unknown_share=0.05):
    """What a fit of that shape (logit F0, tint) takes from the catalogue, by errors of its free numbers."""
    tints = [] if sigma_tint is None else list(sigma_tint)
    coordinates, x = (VIEWERS, shape[:3]) if sigma_tint is None else (EXACT, shape)
    covariance = torch.diag(float64([sigma_f0] * 3 + tints + [0.01]) ** 2)
    x = torch.cat([x, torch.zeros(1, dtype=torch.float64)])
    return catalogue_prior(InReflectance.around(x, coordinates, Covariance(covariance)), metals, unknown_share)


def test_without_word_on_the_tint_it_is_the_normal_distribution_given_f0():
    """One metal alone, F0 exact to 1e-3 in its logit: the tint's mean and covariance by the formula of conditioning.
    The tint's error in n = m^tanh(t) is taken by 2·10⁵ draws; 2000 heavy-tailed draws scatter by 5 % of it."""
    gold, shared = shape_of(metal("Au")), published_covariance()
    seen = gold.clone()
    seen[:3] += 0.3
    found = posterior(seen, 1e-3, metals=[metal("Au")], unknown_share=0.0)
    assert isinstance(found, Borrowed)
    gain = shared[3:, :3] @ torch.linalg.inv(shared[:3, :3])
    mean, covariance = gold[3:] + gain @ (seen - gold)[:3], shared[3:, 3:] - gain @ shared[:3, 3:]
    generator = torch.Generator().manual_seed(0)
    draws = (
        mean + torch.randn(200_000, 3, generator=generator, dtype=torch.float64) @ torch.linalg.cholesky(covariance).T
    )
    n = fresnel.index_limit(torch.sigmoid(seen[:3])) ** torch.tanh(draws)
    low, high = n.quantile(0.025, 0), n.quantile(0.975, 0)
    sigma = n.log().std(0).tolist()
    expected = fresnel.index_limit(torch.sigmoid(seen[:3])) ** torch.tanh(mean)
    for channel, number in enumerate(found.n):
        assert math.log(number.value) == pytest.approx(expected[channel].log().item(), abs=0.05 * sigma[channel])
        assert math.log(number.interval[0]) == pytest.approx(low[channel].log().item(), abs=0.2 * sigma[channel])
        assert math.log(number.interval[1]) == pytest.approx(high[channel].log().item(), abs=0.2 * sigma[channel])


def test_shares_are_those_of_normal_evidence():
    """Gold and brass, F0 halfway between, nothing known of the tint: exp(-½ d²) of each, d² by the covariance of F0."""
    metals = [metal("Au"), metal("CuZn30")]
    shapes = torch.stack([shape_of(each) for each in metals])
    seen = 0.6 * shapes[0] + 0.4 * shapes[1]
    width = published_covariance()[:3, :3] + 0.05**2 * torch.eye(3, dtype=torch.float64)
    away = [(seen - each)[:3] @ torch.linalg.solve(width, (seen - each)[:3]) for each in shapes]
    expected = torch.softmax(-0.5 * torch.stack(away), 0)
    found = posterior(seen, 0.05, metals=metals, unknown_share=0.0)
    assert isinstance(found, Borrowed)
    shares = dict(found.metals)
    assert shares["gold"] == pytest.approx(expected[0].item(), abs=0.05)  # 2000 draws, and F0 normal but its logit not


@pytest.mark.parametrize("name", ["Ag", "Fe", "CuZn30"])
def test_f0_is_kept_exactly(name):
    shape = shape_of(metal(name))
    found = posterior(shape, 0.02, (WIDE,) * 3)
    assert isinstance(found, Borrowed)
    n, k = (float64([each.value for each in numbers]) for numbers in (found.n, found.k))
    torch.testing.assert_close(fresnel.normal_reflectance(n, k), torch.sigmoid(shape[:3]), rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["Au", "Fe"])
def test_what_the_photographs_determine_stays(name):
    """Tints known to 0.01, ten times better than the prior, and half a prior's width off the catalogue's."""
    shape = shape_of(metal(name))
    shape[3:] += 0.5 * published_covariance().diagonal()[3:].sqrt()
    found = posterior(shape, 0.02, (0.01,) * 3)
    assert isinstance(found, Borrowed)
    limit = fresnel.index_limit(torch.sigmoid(shape[:3]))
    tint = torch.atanh(float64([each.value for each in found.n]).log() / limit.log())
    assert ((tint - shape[3:]).abs() < 0.01).all()


def test_one_channel_helps_the_next():
    """Red unknown, green and blue known: published measurements of one metal differ in all channels alike, so red is
    known better than from the catalogue alone, and moves with the others."""
    gold = shape_of(metal("Au"))
    alone, helped = posterior(gold, 0.02, (WIDE,) * 3), posterior(gold, 0.02, (WIDE, 0.02, 0.02))
    shifted = gold.clone()
    shifted[4:] += 0.1
    moved = posterior(shifted, 0.02, (WIDE, 0.02, 0.02))
    assert helped.n[0].stderr < 0.5 * alone.n[0].stderr
    assert moved.n[0].value > helped.n[0].value


def test_a_metal_unlike_all_others_is_not_forced():
    strange = shape_of(metal("Au"))
    strange[:3] = float64([-1.0, 2.0, -1.0])  # green
    found = posterior(strange, 0.02, (WIDE,) * 3)
    assert isinstance(found, TooFar)
    assert found.distance > 2


@pytest.mark.slow
def test_published_measurements_that_the_catalogue_lacks_lie_within_the_intervals(shared_data):
    """Other sources' n and k of its metals, and metals that it lacks, by F0 alone: 174 numbers, three of which are
    one draw, as channels differ alike. So the share within scatters by √(0.95·0.05/58) = 0.029; two of these down.
    Most of these tables set the prior's widths, too: this is a check of its shape, not of its widths."""
    inside = []
    with (shared_data / "ior" / "ior_rgb.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if "refractiveindex" in row["source"] and row["kind"] == "metal"]
    for row in rows:
        n, k = (tuple(float(row[f"{key}_{channel}"]) for channel in "RGB") for key in "nk")
        if row["wavelengths_nm_RGB"] != "630/532/465" or any(abs(m.n[0] - n[0]) < 1e-6 for m in read_catalogue()):
            continue
        found = posterior(shape_of(Metal("", "", n, k, (0, 0, 0), "")), 0.02)
        if isinstance(found, Borrowed):
            pairs = [*zip(found.n, n, strict=True), *zip(found.k, k, strict=True)]
            inside += [each.interval[0] <= truth <= each.interval[1] for each, truth in pairs]
    assert len(inside) > 150
    assert sum(inside) / len(inside) > 0.95 - 2 * 0.029


OWN = {
    "n": [Measured(0.2, 0.3, (0.01, 0.9)), Measured(0.4, 0.01, (0.38, 0.42)), Measured(1.4, 0.01, (1.38, 1.42))],
    "k": [Measured(4.0, 1.0, (2.0, 6.0)), Measured(2.3, 0.1, (2.1, 2.5)), Measured(1.8, 0.5, (1.0, 2.5))],
}
KNOWN = {"n": [False, True, True], "k": [False, True, False]}


def taken(n: tuple[float, ...], k: tuple[float, ...]) -> Borrowed:
    one, other = ([Measured(v, 0.1, (v - 0.2, v + 0.2)) for v in values] for values in (n, k))
    return Borrowed((("gold", 0.9),), (one[0], one[1], one[2]), (other[0], other[1], other[2]))


def test_only_open_channels_take_the_priors_numbers():
    borrowed = taken((0.15, 0.7, 1.405), (3.6, 2.9, 1.85))
    marks, numbers = from_prior(borrowed, OWN, KNOWN), with_prior(borrowed, OWN, KNOWN)
    assert marks is not None
    assert (marks.n, marks.k) == ((True, False, False), (True, False, True))
    assert [each.value for each in numbers["n"]] == [0.15, 0.4, 1.405]  # green is closed; blue's n goes with its k
    assert numbers["n"][2].stderr == 0.01
    assert numbers["k"][0].interval == (3.4, 3.8000000000000003)
    assert marks.photographs95.n == ((0.01, 0.9), (0.38, 0.42), (1.38, 1.42))


def test_a_number_that_moves_by_more_than_its_error_counts_as_the_priors():
    borrowed = taken((0.15, 0.4, 1.45), (3.6, 2.3, 1.85))
    marks = from_prior(borrowed, OWN, KNOWN)
    assert marks is not None
    assert marks.n == (True, False, True)


def test_nothing_is_taken_where_all_is_determined():
    everything = {key: [True] * 3 for key in ("n", "k")}
    borrowed = taken((0.15, 0.7, 1.405), (3.6, 2.9, 1.85))
    assert from_prior(borrowed, OWN, everything) is None
    assert with_prior(borrowed, OWN, everything) == OWN


@pytest.fixture(scope="module")
def light():
    return studio(64)


def gold_of(roughness: float, f0_of: str = "Au") -> shading.Metal:
    known = metal(f0_of)
    return shading.Metal(float64(known.n), float64(known.k), Microfacet(float64(roughness)))


@pytest.mark.parametrize("name", ["Ag", "Fe"])
def test_the_viewers_pair_has_the_fitted_f0_and_the_tint_of_the_metal_it_names(light, name):
    """Silver's F0 is beyond the search's start of 0.95, from which another metal would be nearest."""
    fit = fit_material(problem_of(gold_of(0.2, name), surface_of(16), light, PRESETS["viewer"]), "metal")
    found = borrow(fit, sandwich_covariance(fit.residuals, fit.x), "none")
    assert isinstance(found, Borrowed)
    assert found.metals == ((metal(name).title, 1.0),)
    n, k = (float64([each.value for each in numbers]) for numbers in (found.n, found.k))
    torch.testing.assert_close(fresnel.normal_reflectance(n, k), fit.material.f0, rtol=0, atol=1e-9)
    limit = fresnel.index_limit(fit.material.f0)
    torch.testing.assert_close(torch.atanh(n.log() / limit.log()), shape_of(metal(name))[3:], rtol=0, atol=1e-6)


def test_every_pair_on_the_circle_is_one_picture_to_the_viewer():
    """So that the choice among them is the catalogue's: Lazányi's reflectance, by n anywhere in its limits."""
    f0, cosine = float64(0.8), torch.linspace(0, 1, 50, dtype=torch.float64)
    limit = fresnel.index_limit(f0).item()
    n = torch.linspace(1.001 / limit, 0.999 * limit, 20, dtype=torch.float64)[:, None]
    picture = fresnel.lazanyi(cosine, n, fresnel.extinction(f0, n))
    torch.testing.assert_close(picture, fresnel.schlick(cosine, f0).expand(20, 50), rtol=0, atol=1e-12)


def noisy_fit(light, name: str, level: float) -> Fit:
    """Of photographs with noise."""
    problem = problem_of(gold_of(0.3, name), surface_of(16, 2), light, preset("preview"), samples=1024)
    seen = problem.observed.radiance
    noise = torch.randn(seen.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    problem = replace(problem, observed=replace(problem.observed, radiance=seen * (1 + level * noise)))
    fit = fit_material(problem, "metal")
    return replace(fit, x=problem.solver(fit.residuals, fit.x, 1e-10).x)


def deviance(fit: Fit, x: torch.Tensor) -> float:
    """How much worse another free vector explains the photographs, by all pixels, without the prior on the tint."""

    def of_pixels(x: torch.Tensor) -> torch.Tensor:
        return fit.residuals(x).square().sum() - (x[3:6] / TINT_WIDTH).square().sum()

    return float(of_pixels(x) - of_pixels(fit.x))


def with_best_roughness(fit: Fit, x: torch.Tensor) -> torch.Tensor:
    """The free vector with the roughness that explains the photographs best."""
    from scipy.optimize import minimize_scalar

    def at(roughness: float) -> torch.Tensor:
        return torch.cat([x[:6], x.new_tensor([roughness])])

    found = minimize_scalar(lambda each: float(fit.residuals(at(each)).square().sum()), bracket=(-0.2, 0.2))
    return at(found.x)


def shape_steps(fit: Fit) -> Iterator[torch.Tensor]:
    """Along the tints of red and green, as far as where the nearest tangent has three standard deviations."""
    slope = torch.func.jacfwd(fit.residuals)(fit.x)
    for which in (3, 4):
        error = fit.residuals(fit.x).square().mean().sqrt() / slope[:, which].norm()
        for step in (-3, -2, 2, 3):
            yield fit.x + step * error * torch.eye(7, dtype=torch.float64)[which]


@pytest.mark.parametrize(("name", "level"), [("Au", 0.1), ("Fe", 0.1), ("Ag", 0.1), ("Ag", 0.025)])
def test_the_likelihood_is_the_pictures_own(light, name, level):
    """But for κ against the sum of squares of all pixels, its roughness sought anew; the robust loss, which weighs anew
    what is beyond the threshold, one pixel in a hundred, moves a twentieth of it."""
    fit = noisy_fit(light, name, level)
    found = likelihood(fit, sandwich_covariance(fit.residuals, fit.x))
    assert isinstance(found, InPictures)
    for x in shape_steps(fit):
        real = deviance(fit, with_best_roughness(fit, x))
        assumed = (float(found(x[:6]).square().sum()) - found.least) * found.scale.item() ** 2
        assert assumed == pytest.approx(real, rel=0.05, abs=0.1)


def test_the_likelihoods_slope_is_its_derivative(light):
    fit = noisy_fit(light, "Au", 0.1)
    found, shape = likelihood(fit, sandwich_covariance(fit.residuals, fit.x)), fit.x[:6] + 0.1
    step = 1e-5 * torch.eye(6, dtype=torch.float64)
    differences = (found(shape + step) - found(shape - step)).T / 2e-5
    torch.testing.assert_close(found.slope(shape), differences, rtol=1e-6, atol=1e-6 * differences.abs().max().item())


def test_two_reflectances_stand_for_a_metal_of_which_much_is_seen(light):
    """Iron, noise of 10 %: along one tint, alpha held, the reflectance between 45° and 70° stands for all angles within
    a factor of two up to three standard deviations, and four upwards; a parabola in the tint, 16 there, would be beyond
    it, where the real one is 3.5."""
    fit = noisy_fit(light, "Fe", 0.1)
    jacobian = torch.func.jacfwd(fit.residuals)(fit.x)[:, :6]
    variance = float(fit.residuals(fit.x).square().sum()) / (len(fit.residuals(fit.x)) - 7)
    precision = jacobian.T @ jacobian / variance
    covariance = torch.eye(7, dtype=torch.float64)
    covariance[:6, :6] = torch.linalg.inv(precision)
    assumed = InReflectance.around(fit.x, EXACT, Covariance(covariance))
    for which, steps in ((3, (-3, -2, 2, 3)), (4, (-3, -2, 2, 3, 4))):
        for step in steps:
            there = fit.x.clone()
            there[which] += step / precision[which, which].sqrt()
            real = deviance(fit, there) / variance
            assert 0.5 * real - 0.3 < float(assumed(there[:6]).square().sum()) < 2 * real + 0.3, (which, step)


def test_a_fit_says_where_its_numbers_come_from(light):
    """Noise of 30 % leaves red gold's n and k open, and the catalogue knows them better."""
    problem = problem_of(gold_of(0.3), surface_of(12, 2), light, preset("preview"), samples=512)
    seen = problem.observed.radiance
    noise = torch.randn(seen.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    problem = replace(problem, observed=replace(problem.observed, radiance=seen * (1 + 0.3 * noise)))
    fit = fit_material(problem, "metal")
    uncertainty = sandwich_covariance(fit.residuals, fit.x)
    borrowed = borrow(fit, uncertainty, "catalogue")
    rho = ViewerRoughness(0.8, 0.01)
    bare = fitted_material("ball", fit, uncertainty, rho, ())
    found = fitted_material("ball", fit, uncertainty, rho, (), borrowed)
    assert bare.from_prior is None
    assert found.from_prior is not None
    assert found.determined == bare.determined
    assert found.f0 == bare.f0
    assert not found.determined.n[0]
    assert found.from_prior.n[0]
    assert found.from_prior.photographs95.n[0] == bare.interval95.n[0]
    assert found.interval95.n[0][1] - found.interval95.n[0][0] < bare.interval95.n[0][1] - bare.interval95.n[0][0]
    assert found.interval95.n[0][0] < metal("Au").n[0] < found.interval95.n[0][1]
    choice = Choice(fit, {"metal": 0.0})
    told = describe(choice, found, seen_by(fit, problem.observed), borrowed)
    assert "come from the catalogue's gold" in told
    assert "not from the photographs." in told
