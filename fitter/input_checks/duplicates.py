"""Findings about photographs that are the same photograph: even their noise is the same."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.input_checks.finding import Finding
from fit_material.fitter.least_squares.noise import MAD_TO_SIGMA
from fit_material.fitter.observations.photograph import Photograph

SAME = 0.5  # of the difference that two photographs' own noise would make
ROWS, MOST = 48, 200  # rows that are compared; photographs
LEAST = 1e-5  # of noise; where light is even, photographs are alike and yet not the same
FEWEST = 200  # pixels that both have


def duplicate_findings(rows: Sequence[Float[Tensor, "r w"]], names: Sequence[str]) -> list[Finding]:
    """Pairs of `rows_of` photographs that differ by less than independent noise would make them differ."""
    pixels = rows[:MOST]
    noise = [_noise(each) for each in pixels]
    found = []
    repeated: set[int] = set()
    for i, j in combinations(range(len(pixels)), 2):
        if j in repeated or pixels[i].shape != pixels[j].shape:
            continue
        both = (pixels[i] > 0) & (pixels[j] > 0)
        if both.sum() < FEWEST:
            continue
        difference = (pixels[i] / pixels[j].clamp_min(1e-30)).log()[both]
        difference = MAD_TO_SIGMA * float((difference - difference.median()).abs().median())
        alone = (noise[i] ** 2 + noise[j] ** 2) ** 0.5
        if difference <= SAME * alone and alone > LEAST:
            repeated.add(j)
            value = (
                f"the same photograph as {names[i]}: they differ by {difference:.2g} of their light, and independent"
            )
            value += f" noise alone would by {alone:.2g}"
            found.append(Finding("duplicate", names[j], value, "leave one out, or give the right file"))
    return found


def rows_of(photograph: Photograph) -> Float[Tensor, "r w"]:
    """Some rows of the object's light; 0 beside it."""
    light = photograph.radiance.mean(-1) * photograph.mask
    return light[:: max(1, len(light) // ROWS)]


def _noise(rows: Float[Tensor, "r w"]) -> float:
    """Relative standard deviation, by second differences along rows, which hardly see the object's own shading."""
    left, middle, right = rows[:, :-2], rows[:, 1:-1], rows[:, 2:]
    known = (left > 0) & (middle > 0) & (right > 0)
    if known.sum() < FEWEST:
        return 0.0
    bend = ((2 * middle - left - right) / middle.clamp_min(1e-30))[known]
    return MAD_TO_SIGMA * float(bend.abs().median()) / 6**0.5
