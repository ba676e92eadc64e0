"""The sRGB curve of IEC 61966-2-1, written out in float64: what readers and writers are held against."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def encoded(linear: ArrayLike) -> np.ndarray:
    """Codes of linear values; those beyond 1 stay beyond it."""
    x = np.asarray(linear, dtype=float)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)


def decoded(code: ArrayLike) -> np.ndarray:
    """Linear values of codes."""
    x = np.asarray(code, dtype=float)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
