"""Findings about photographs that are out of focus or shaken: their object's edge is wide."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from torch import Tensor

from fit_material.fitter.input_checks.finding import Finding
from fit_material.fitter.observations.photograph import Photograph

WIDE = 3.0  # pixels; what a sharp lens draws is 1 to 2 wide, 2.7 at most over a varied background
WIDE_SHARE = 0.015  # of the object's size: what a larger photograph may be blurred by without harm
CONTRAST = 0.2  # of the profile's brightest, below which it shows no edge
PROFILES = 400
FEWEST = 24
REACH, STEP = 6, 0.25  # pixels to either side, and between samples
AROUND = 4  # pixels that determine an edge's direction


def sharpness_finding(photograph: Photograph, inside: Bool[Tensor, "h w"], where: str) -> Finding | None:
    """The width of the object's edge, where it is too large; `inside` is where the object is."""
    width = edge_width(photograph.radiance.mean(-1).numpy(), inside.numpy())
    size = float(inside.sum()) ** 0.5
    if width is None or width < max(WIDE, WIDE_SHARE * size):
        return None
    value = f"blurred: the object's edge is {width:.1f} pixels wide"
    return Finding("sharpness", where, value, "use a sharp photograph, or a smaller copy of this one")


def edge_width(light: Float[np.ndarray, "h w"], inside: Bool[np.ndarray, "h w"]) -> float | None:
    """Median over the edge's profiles of their step over their steepest slope, in pixels; None without contrast.

    Of a step blurred by a Gaussian this is √(2π) times its standard deviation; of a sharp one, 1 to 2.
    """
    place = _edge_places(inside)
    outwards = _outwards(inside, place)
    known = np.hypot(*outwards) > 0
    if known.sum() < FEWEST:
        return None
    along = np.arange(-REACH, REACH + STEP, STEP)
    steps = (outwards / np.maximum(np.hypot(*outwards), 1e-9))[:, known, None] * along
    root = np.sqrt(np.maximum(light, 0))  # lamps and their reflections shall not drown the edge
    profile = ndimage.map_coordinates(root, place[:, known, None] + steps, order=1)
    slope = np.abs(np.diff(profile, axis=1)).max(1) / STEP
    step = np.abs(profile[:, along <= -3].mean(1) - profile[:, along >= 3].mean(1))
    clear = step > CONTRAST * profile.max(1)
    return float(np.median(step[clear] / slope[clear])) if clear.sum() >= FEWEST else None


def _edge_places(inside: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "2 p"]:
    """Row and column of some pixels of the object that have a neighbour beside it, away from the picture's border."""
    within = inside[1:-1, 1:-1]
    surrounded = inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    place = np.array((within & ~surrounded).nonzero()) + 1
    far = (place >= REACH + 1) & (place < np.array(inside.shape)[:, None] - REACH - 1)
    place = place[:, far.all(0)]
    return place[:, :: max(1, place.shape[1] // PROFILES)]


def _outwards(inside: Bool[np.ndarray, "h w"], place: Int[np.ndarray, "2 p"]) -> Float[np.ndarray, "2 p"]:
    """The direction away from the object, as the pixels around each place have it; of any length."""
    offset = np.mgrid[-AROUND : AROUND + 1, -AROUND : AROUND + 1].reshape(2, -1)
    row, column = place[:, :, None] + offset[:, None]
    return -(inside[row, column] * offset[:, None]).sum(-1).astype(float)
