"""The ten numbers of a metal, as true, as found, and as well as they could be known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from fit_material.fitter.least_squares.covariance import TWO_SIDED_95
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.materials.catalogue import metal
from fit_material.shaders.optics import fresnel
from tests.bench.cramer_rao import Bound
from tests.bench.photographs import Case

KEYS = ("f0", "n", "k", "alpha")
SLICES = {"f0": slice(0, 3), "n": slice(3, 6), "k": slice(6, 9), "alpha": slice(9, 10)}
DETERMINED = 0.1  # of the value, by the half width of the 95 % interval: the benchmark's own demand
STEEPEST = 85  # degrees, up to which reflectance curves are compared


@dataclass(frozen=True)
class Estimate:
    """F0, n, k per channel and alpha with standard errors and 95 % intervals; NaN where there are none."""

    value: Float[np.ndarray, "10"]
    stderr: Float[np.ndarray, "10"]
    low: Float[np.ndarray, "10"]
    high: Float[np.ndarray, "10"]

    @property
    def half_width(self) -> Float[np.ndarray, "10"]:
        """Of the 95 % interval."""
        return (self.high - self.low) / 2

    @property
    def is_determined(self) -> Bool[np.ndarray, "10"]:
        """By `DETERMINED`; never where there is no interval."""
        return self.half_width < DETERMINED * np.abs(self.value)

    def holds(self, truth: Float[np.ndarray, "10"]) -> Bool[np.ndarray, "10"]:
        """Whether each interval contains the truth."""
        return (self.low <= truth) & (truth <= self.high)

    def deviation(self, truth: Float[np.ndarray, "10"]) -> Float[np.ndarray, "10"]:
        """Errors in stated standard errors."""
        return (self.value - truth) / self.stderr

    def over(self, bound: Bound) -> Float[np.ndarray, "10"]:
        """Half widths over those of the Cramér-Rao bound."""
        return self.half_width / (TWO_SIDED_95 * _in_order(bound.f0, bound.n, bound.k, bound.alpha))


NOTHING = Estimate(*np.full((4, 10), np.nan))


def estimate_of(found: FittedMaterial) -> Estimate:
    """The numbers of a fit."""
    low, high = np.array(_numbers(found.interval95, (None, None)), float).T
    value, stderr = (np.array(_numbers(each, None), float) for each in (found, found.stderr))
    return Estimate(value, stderr, low, high)


def stated_determined(found: FittedMaterial) -> Bool[np.ndarray, "10"]:
    """Which numbers the fit itself calls determined."""
    return np.array(_numbers(found.determined, False), bool)


def true_numbers(case: Case) -> Float[np.ndarray, "10"]:
    """The numbers that were photographed."""
    known = metal(case.metal)
    index = np.array(known.n) + 1j * np.array(known.k)
    return _in_order(np.abs((index - 1) / (index + 1)) ** 2, known.n, known.k, case.alpha)


def curve_error(found: Float[np.ndarray, "10"], truth: Float[np.ndarray, "10"]) -> float:
    """Largest difference of the exact reflectance curves over channels and angles of 0° to 85°."""
    cosine = torch.deg2rad(torch.arange(0.0, STEEPEST + 1, dtype=torch.float64)).cos()[:, None]
    curves = [fresnel.conductor(cosine, *(torch.from_numpy(x[SLICES[key]]) for key in "nk")) for x in (found, truth)]
    return float((curves[0] - curves[1]).abs().max())


def _in_order(f0: object, n: object, k: object, alpha: object) -> Float[np.ndarray, "10"]:
    return np.concatenate([np.atleast_1d(np.asarray(each, float)) for each in (f0, n, k, alpha)])


def _numbers(record: object, missing: object) -> list:
    """Of a record by parameter, in the order of `KEYS`; `missing` in the place of None."""
    found: list = []
    for key, place in SLICES.items():
        entry, count = getattr(record, key), place.stop - place.start
        entries: Sequence = (entry,) if count == 1 else entry or (None,) * count
        found += [missing if each is None else each for each in entries]
    return found
