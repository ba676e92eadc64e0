"""Findings about photographs that are out of focus or shaken: their object's edge is wide."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from torch import Tensor

from fitter.photographs import Photograph
from fitter.preflight.finding import Finding

WIDE = 3.0  # pixels; what a sharp lens draws is 1 to 2 wide, 2.7 at most over a varied background
WIDE_SHARE = 0.015  # of the object's size: what a larger photograph may be blurred by without harm
CONTRAST = 0.2  # of the profile's brightest, below which it shows no edge
PROFILES = 400
FEWEST = 24
REACH = 6  # pixels to either side


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

    Of a step blurred by a Gaussian this is √(2π) times its standard deviation; of a sharp one, 1.
    """
    from skimage.segmentation import find_boundaries

    rows, columns = find_boundaries(inside, mode="inner").nonzero()
    if len(rows) < FEWEST:
        return None
    every = max(1, len(rows) // PROFILES)
    rows, columns = rows[::every], columns[::every]
    soft = ndimage.gaussian_filter(inside.astype(float), 2.0)
    down, right = (ndimage.map_coordinates(axis, [rows, columns], order=1) for axis in np.gradient(soft))
    length = np.hypot(down, right)
    known = length > 1e-3
    along = np.arange(-REACH, REACH + 0.25, 0.25)
    where = [
        place[known, None] - step[known, None] / length[known, None] * along
        for place, step in ((rows, down), (columns, right))
    ]
    within = np.all([(w >= 0) & (w <= n - 1) for w, n in zip(where, light.shape, strict=True)], axis=(0, 2))
    profile = ndimage.map_coordinates(np.sqrt(np.maximum(light, 0)), where, order=1)[within]
    if len(profile) < FEWEST:
        return None
    slope = np.abs(np.diff(profile, axis=1)).max(1) / 0.25
    step = np.abs(profile[:, along <= -3].mean(1) - profile[:, along >= 3].mean(1))
    clear = step > CONTRAST * np.abs(profile).max(1)
    return float(np.median(step[clear] / slope[clear])) if clear.sum() >= FEWEST else None
