"""Linear radiance as a display shows it."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

from fit_material.shaders.tone_mapping import srgb


def white_point(radiance: Float[np.ndarray, "*p 3"], percentile: float = 99.9) -> float:
    """The radiance shown as white: `percentile` of all values, or 1 if that is not positive."""
    white = float(np.percentile(radiance, percentile)) if radiance.size else 1.0
    return white if white > 0 else 1.0


def tone_mapped(radiance: Float[np.ndarray, "*p 3"], white: float) -> Float[np.ndarray, "*p 3"]:
    """Linear radiance as a display shows it: x = radiance/white clipped to [0, 1], then the sRGB curve."""
    x = np.clip(radiance / white, 0, 1)
    return srgb(torch.from_numpy(x)).numpy()
