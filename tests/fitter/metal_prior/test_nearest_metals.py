"""Distances to known metals: against normal theory, and what must hold of any distance."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fit_material.fitter.least_squares.covariance import Covariance
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.metal_prior.nearest_metals import nearest_metals
from fit_material.renderer.materials.catalogue import metal, read_catalogue
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.optics import fresnel

RANGE = WidthInterval(0.02, 1.0, logarithmic=True)
EXACT = MetalCoordinates(RANGE)
names = st.sampled_from([each.name for each in read_catalogue()])


def free(name: str) -> torch.Tensor:
    known = metal(name)
    n, k, alpha = (torch.tensor(v, dtype=torch.float64) for v in (known.n, known.k, 0.2))
    return EXACT.free(Metal(n, k, Microfacet(alpha)))


def spread_of(sigma: float, size: int = 7) -> Covariance:
    return Covariance(sigma**2 * torch.eye(size, dtype=torch.float64))


def distances(x, spread, coordinates=EXACT, metals=None) -> dict[str, float]:
    return {each.name: each.distance for each in nearest_metals(x, coordinates, spread, metals)}


@settings(max_examples=20)
@given(names, st.floats(1e-6, 1.0))
def test_the_truth_is_at_distance_zero(name, sigma):
    """The catalogue's n and k come back from the free vector to 1e-10, of a floor of 2e-3."""
    first = nearest_metals(free(name), EXACT, spread_of(sigma))[0]
    assert (first.name, first.distance) == (metal(name).title, pytest.approx(0, abs=1e-6))


@given(names, st.permutations(read_catalogue()))
@settings(max_examples=5)
def test_the_order_of_the_catalogue_does_not_matter(name, metals):
    x, spread = free(name), spread_of(0.1)
    assert nearest_metals(x, EXACT, spread, metals) == nearest_metals(x, EXACT, spread)


@settings(max_examples=30)
@given(names, st.sampled_from(range(6)), st.floats(0.02, 0.5), st.floats(1.2, 3.0), st.floats(1e-3, 0.3))
def test_it_grows_with_the_difference_and_shrinks_with_the_error(name, which, little, times, sigma):
    """One number moved away from the metal by a little, and by more: every reflectance moves on, none turns back."""
    x, step, title = free(name), torch.eye(7, dtype=torch.float64)[which], metal(name).title

    def away(by: float, error: float) -> float:
        return distances(x + by * step, spread_of(error), metals=[metal(name)])[title]

    assert away(little * times, 1e-6) > away(little, 1e-6) > 0
    assert away(little, sigma) > away(little, 2 * sigma)


def test_fits_that_scatter_by_their_covariance_are_at_distance_one_in_the_root_mean_square():
    """d²q is χ² of q = 6 where the floor is small against the errors: mean 1 ± √(2/6/200) = 0.041. The floor of 0.002
    lowers it, by 0.04 at errors of 0.05 in logit and tint, and the bend of the reflectances changes as little."""
    generator, sigma = torch.Generator().manual_seed(3), 0.05
    squares = []
    for _ in range(200):
        x = free("Cu") + sigma * torch.randn(7, generator=generator, dtype=torch.float64)
        squares.append(distances(x, spread_of(sigma), metals=[metal("Cu")])["copper"] ** 2)
    assert torch.tensor(squares).mean().item() == pytest.approx(1, abs=4 * 0.041 + 0.08)


def test_correlated_errors_do_not_hide_a_difference_against_their_direction():
    """Errors that move all F0 together forgive a common shift, and none between channels. In the root mean square of
    single errors both would be one σ away."""
    shared = torch.zeros(7, dtype=torch.float64)
    shared[:3] = 0.1
    spread = Covariance(torch.outer(shared, shared) + 1e-8 * torch.eye(7, dtype=torch.float64))
    along, against = shared, shared * torch.tensor([1.0, -1, 0, 0, 0, 0, 0], dtype=torch.float64)
    assert distances(free("Cu") + along, spread)["copper"] < 0.6
    assert distances(free("Cu") + against, spread)["copper"] > 3


@pytest.mark.parametrize("sigma", [0.0, 1e60])
def test_degenerate_covariances_give_finite_distances(sigma):
    """Nothing known at all: every metal is within one σ of the greatest distance, √(12/6) at errors of all."""
    found = distances(free("Au"), Covariance(torch.diag(torch.tensor([sigma] * 7, dtype=torch.float64))))
    assert all(torch.isfinite(torch.tensor(list(found.values()))))
    assert found["gold"] < 1e-6


def test_in_the_viewers_model_only_f0_counts():
    """By hand: (F0 - F0')² / (σ² + 0.002²), summed over channels, over 3; whatever the tint that stands for it."""
    tint = torch.tensor([2.0, -1.0, 0.5], dtype=torch.float64)
    held = MetalCoordinates(RANGE, tint)
    x = free("Au")[[0, 1, 2, 6]]
    f0 = torch.sigmoid(x[:3])
    sigma = 0.1 * f0 * (1 - f0)
    silver = metal("Ag")
    n, k = (torch.tensor(v, dtype=torch.float64) for v in (silver.n, silver.k))
    expected = ((fresnel.normal_reflectance(n, k) - f0) ** 2 / (sigma**2 + 0.002**2)).sum() / 3
    found = distances(x, spread_of(0.1, 4), held)
    assert found["silver"] == pytest.approx(expected.sqrt().item(), rel=1e-6)
    assert found["gold"] < 1e-6
