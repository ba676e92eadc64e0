"""What the benchmarks compute themselves: their photographs' noise, and the bound that fits are held against."""

import json
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
import torch

from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from tests.bench import large_photographs, noise, photographs
from tests.bench.cramer_rao import Bound, bound, information
from tests.bench.estimates import Estimate, curve_error, estimate_of, true_numbers
from tests.bench.measured_fit import STAGES, Asked, Measured, measured
from tests.bench.scaling import slope

GOLD = TrueMetal((0.146, 0.425, 1.431), (3.578, 2.326, 1.85), alpha=0.2)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(photographs, "CACHE", tmp_path / "cache")
    return tmp_path / "cache"


def test_noise_put_on_kept_photographs_is_what_synth_would_have_made(tmp_path, cache, monkeypatch):
    options = SynthOptions(GOLD, views=2, size=8, spp=4, noise=0.01, seed=7, variant="scalar_rgb")
    made = synthesise(options, tmp_path / "made").parent
    clean = photographs.photographed(SynthOptions(GOLD, views=2, size=8, spp=4, seed=7, variant="scalar_rgb"), "gold")
    monkeypatch.setattr(photographs, "synthesise", None)  # no path is traced again
    kept = photographs.photographed(options, "gold").parent
    names = sorted(path.name for path in made.iterdir())
    assert sorted(path.name for path in kept.iterdir()) == names
    for name in names:
        assert (kept / name).read_bytes() == (made / name).read_bytes(), name
    assert json.loads(clean.with_name("truth.json").read_text())["noise"] == 0


def test_the_information_is_that_of_whitened_residuals():
    random = np.random.default_rng(1)
    jacobian, factor = random.normal(size=(50, 3, 4)), 0.3 * np.tril(random.normal(size=(50, 3, 3))) + 2 * np.eye(3)
    white = np.linalg.solve(factor, jacobian).reshape(-1, 4)
    found = information(jacobian, factor @ factor.transpose(0, 2, 1), np.full(50, 1e12))
    np.testing.assert_allclose(found, white.T @ white, rtol=1e-9)


@pytest.mark.parametrize("freedom", [9, 40])
def test_covariances_from_few_passes_do_not_feign_information(freedom):
    """The mean over many sample covariances is the information of the true one, within its standard error."""
    random, pixels = np.random.default_rng(2), 20_000
    truth = np.array([[2.0, 1.8, 1.0], [1.8, 2.0, 1.2], [1.0, 1.2, 1.0]])
    drawn = scipy.stats.wishart(freedom, truth / freedom, seed=random).rvs(pixels)
    direction = np.array([1.0, -1.0, 0.5])[:, None]
    each = [information(direction[None], one[None], np.array([freedom])).item() for one in drawn[:2000]]
    true = (direction.T @ np.linalg.inv(truth) @ direction).item()
    mean = information(np.tile(direction, (pixels, 1, 1)), drawn, np.full(pixels, float(freedom))).item() / pixels
    assert abs(mean - true) < 4 * np.std(each) / pixels**0.5
    assert abs(freedom / (freedom - 4) * mean - true) > 10 * np.std(each) / pixels**0.5  # uncorrected it would


def test_noise_is_measured_with_its_correlation_and_only_where_the_object_is():
    """Normal pictures of known relative covariance; s² of ν·9 degrees of freedom is right to √(2/9ν) = 4 %."""
    random = np.random.default_rng(3)
    level = np.linspace(1, 4, 12)[None, :, None] * np.array([1.0, 0.5, 2.0])
    relative = np.array([[1.0, 0.9, 0.5], [0.9, 1.0, 0.4], [0.5, 0.4, 1.0]]) * 0.04
    factor = np.linalg.cholesky(relative / noise.SAMPLES)

    def picture() -> np.ndarray:
        colour = level * (1 + random.normal(size=(10, 12, 3)) @ factor.T)
        return np.concatenate([colour, np.broadcast_to(np.arange(12) > 0, (10, 12))[..., None]], -1).astype(np.float32)

    measured = noise._measured(iter([(picture() for _ in range(noise.PASSES))]))
    found = noise._smooth(*(measured[key].astype(float) for key in ("mean", "covariance")), measured["covered"], 3)
    assert (found.freedom[0, :, 0] == 0).all()
    assert (found.freedom[0, 1:-1, 2:-1] == 9 * (noise.PASSES - 1)).all()
    expected = relative * level[..., :, None] * level[..., None, :]
    ratio = (found.covariance[0] / expected)[1:-1, 2:-1]
    # ten standard errors where correlations are weakest, 0.4: √(1 + 1/0.4²) times that of a variance, by √½
    np.testing.assert_allclose(ratio, 1, atol=5 * 0.042 * 0.5**0.5 * (1 + 1 / 0.4**2) ** 0.5)
    diagonal = np.diagonal(ratio, axis1=-2, axis2=-1)
    assert abs(diagonal.mean() - 1) < 0.03  # 80 pixels, of which some 9 at a time share their passes


def test_the_bound_of_f0_follows_from_that_of_n_and_k():
    case = photographs.Case("Au", 0.2)
    covariance = np.diag(np.linspace(1e-6, 7e-6, 7))
    found = bound(np.linalg.inv(covariance), case)
    n, k = (torch.tensor(each, dtype=torch.float64) for each in (metal("Au").n, metal("Au").k))
    below = (n + 1) ** 2 + k**2  # F0 = 1 - 4n/[(n+1)² + k²]
    by_n, by_k = 4 * (2 * n * (n + 1) - below) / below**2, 8 * n * k / below**2
    expected = (by_n**2 * torch.linspace(1e-6, 3e-6, 3) + by_k**2 * torch.linspace(4e-6, 6e-6, 3)).sqrt()
    np.testing.assert_allclose(found.f0, expected, rtol=1e-6)
    np.testing.assert_allclose([*found.n, *found.k, found.alpha], np.sqrt(np.diag(covariance)), rtol=1e-9)


def test_an_estimate_is_judged_by_hand():
    truth = true_numbers(photographs.Case("Fe", 0.1))
    assert truth[[3, 6, 9]].tolist() == [2.89238, 3.06548, 0.1]
    stderr = 0.03 * truth
    found = Estimate(1.03 * truth, stderr, truth, truth + 4 * stderr)
    assert found.holds(truth).all()
    assert not found.holds(0.99 * truth).any()
    assert found.is_determined.all()
    np.testing.assert_allclose(found.deviation(truth), 1)
    one = Bound(stderr[3:6], stderr[6:9], stderr[:3], stderr[9])
    np.testing.assert_allclose(found.over(one), 2 / 1.959964)
    assert not Estimate(truth, stderr, truth - 0.11 * truth, truth + 0.11 * truth).is_determined.any()


def test_a_fit_without_a_metal_holds_and_determines_nothing():
    found = estimate_of(FittedMaterial(name="ball", type="matte", color=(0.5, 0.5, 0.5)))
    truth = true_numbers(photographs.Case("Fe", 0.1))
    assert not found.holds(truth).any()
    assert not found.is_determined.any()


def test_curves_differ_most_where_n_and_k_do_though_f0_is_equal():
    """Gold's blue, and the dielectric-like metal on the same circle of F0; Born & Wolf by complex numbers."""
    found, truth = (true_numbers(photographs.Case("Au", 0.2)) for _ in range(2))
    found[5], found[8] = 3.0, (truth[2] * 16 - 4) ** 0.5 / (1 - truth[2]) ** 0.5
    cosine = np.cos(np.deg2rad(np.arange(86)))

    def reflectance(n: float, k: float) -> np.ndarray:
        index = n + 1j * k
        inside = np.sqrt(index**2 - 1 + cosine**2)
        amplitudes = (cosine - inside) / (cosine + inside), (index**2 * cosine - inside) / (index**2 * cosine + inside)
        return sum(np.abs(each) ** 2 for each in amplitudes) / 2

    expected = np.abs(reflectance(found[5], found[8]) - reflectance(truth[5], truth[8])).max()
    assert curve_error(found, truth) == pytest.approx(expected, rel=1e-9)


def test_the_slope_of_a_power_is_its_exponent_with_the_error_of_a_regression():
    x = np.geomspace(1e3, 1e6, 7)
    assert slope(x, 3 * x**0.5) == (pytest.approx(0.5), pytest.approx(0, abs=1e-9))
    y = x**0.9 * np.exp(np.random.default_rng(4).normal(scale=0.1, size=7))
    known = scipy.stats.linregress(np.log(x), np.log(y))
    assert slope(x, y) == (pytest.approx(known.slope), pytest.approx(known.stderr))
    assert slope((1, 100), (2.0, 20.0))[0] == pytest.approx(0.5)


@pytest.mark.slow
def test_a_fit_is_measured_and_one_that_needs_too_much_memory_says_so(cache, monkeypatch):
    """Whole processes: a small fit, and one without room to import anything in."""
    monkeypatch.setattr(large_photographs, "CACHE", cache)
    asked = Asked(str(large_photographs.Series(2, 64, 64).scene()), 500, 16, 8 << 30)
    found = measured(asked)
    assert isinstance(found, Measured), found
    assert 0 < found.pixels <= 500
    assert sum(found.seconds[stage] for stage in STAGES[:4]) == pytest.approx(found.seconds["total"], rel=0.05)
    assert {"starting", "choosing pixels", "writing the report"} <= found.peaks.keys()
    assert 100e6 < found.peak < 8 << 30
    told = measured(replace(asked, limit=64 << 20))
    assert isinstance(told, str)
