"""A camera's response curve, from several exposures of one view."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from fit_material.renderer.errors.input_error import InputError

CODES = 256  # of 16-bit samples the upper eight
MIDDLE = 128  # code that the curve leaves where sRGB has it: exposures alone do not determine a factor
SAMPLES = 200  # pixels per channel; Debevec needs more than CODES over one less than the exposures
SMOOTHNESS = 30.0  # λ, Debevec's lambda
FLATTEST = 1e-3  # of the logarithm of exposures, below which they are the same

Curve = Float[np.ndarray, "256 3"]


def fitted_response(
    codes: Int[np.ndarray, "p e 3"], exposures: Sequence[float], srgb: Float[np.ndarray, " 256"], file: Path
) -> Curve:
    """The radiance that each code stands for, by channel.

        minimise Σ w(z)² [g(z) - ln L - ln t]² + λ Σ w(z)² [g(z-1) - 2g(z) + g(z+1)]²,   g = ln of the curve
        w(z) = min(z, 255 - z)        [Debevec & Malik 1997, eqs. 3 and 4]

    Args:
        codes: of some pixels in all exposures.
        exposures: their relative exposures t.
        srgb: what sRGB makes of each code; the curve agrees with it at `MIDDLE`.
        file: the first exposure, for the error's sentence.

    Returns:
        rising with the code, > 0.

    Raises:
        InputError: the exposures are all the same, or no pixel is at different codes in two of them.
    """
    if np.ptp(np.log(exposures)) < FLATTEST:
        raise InputError(file, "encoding", '"fit"', "images of different exposures, or a curve that is given")
    spread = codes[np.ptp(codes, axis=1).min(-1) > 0]
    if len(spread) < CODES // (len(exposures) - 1):
        raise InputError(file, "encoding", '"fit"', "images whose pixels differ from exposure to exposure, or a curve")
    logs = np.stack([_channel(_evenly(spread[..., i]), np.log(exposures)) for i in range(3)], -1)
    curve = np.exp(np.maximum.accumulate(logs - logs[MIDDLE], axis=0))
    return curve * srgb[MIDDLE]


def through(stored: Float[np.ndarray, "h w 3"], curve: Curve) -> Float[np.ndarray, "h w 3"]:
    """What stored values, in [0, 1], stand for; between codes on a straight line."""
    codes = np.arange(CODES) / (CODES - 1)
    return np.stack([np.interp(stored[..., i], codes, curve[:, i]) for i in range(3)], -1).astype(np.float32)


def _evenly(codes: Int[np.ndarray, "p e"]) -> Int[np.ndarray, "q e"]:
    """At most `SAMPLES` pixels, from dark to bright ones in even steps."""
    order = np.argsort(codes.sum(1), kind="stable")
    return codes[order[np.linspace(0, len(order) - 1, min(SAMPLES, len(order))).astype(int)]]


def _channel(codes: Int[np.ndarray, "p e"], log_exposures: Float[np.ndarray, " e"]) -> Float[np.ndarray, " 256"]:
    """g of one channel, 0 at `MIDDLE`; by least squares over g and the pixels' ln L."""
    from scipy.sparse import coo_array, vstack

    count, exposures = codes.shape
    z, weight = codes.ravel(), _weight(codes.ravel())
    row = np.arange(len(z))
    pixel = CODES + np.repeat(np.arange(count), exposures)
    entries = np.concatenate([weight, -weight]), (np.concatenate([row, row]), np.concatenate([z, pixel]))
    data = coo_array(entries, shape=(len(z), CODES + count))
    inner = np.arange(1, CODES - 1)
    bend = np.sqrt(SMOOTHNESS) * _weight(inner)
    columns = np.concatenate([inner - 1, inner, inner + 1])
    curved = np.concatenate([bend, -2 * bend, bend]), (np.tile(inner - 1, 3), columns)
    smooth = coo_array(curved, shape=(CODES - 2, CODES + count))
    fixed = coo_array(([1.0], ([0], [MIDDLE])), shape=(1, CODES + count))
    known = np.concatenate([weight * np.tile(log_exposures, count), np.zeros(CODES - 1)])
    return np.linalg.lstsq(vstack([data, smooth, fixed]).toarray(), known)[0][:CODES]


def _weight(z: Int[np.ndarray, "*p"]) -> Float[np.ndarray, "*p"]:
    """Codes in the middle count most; those at either end may be clipped and count nothing."""
    return np.minimum(z, CODES - 1 - z).astype(float)
