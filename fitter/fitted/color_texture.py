"""A colour map that was found, and what it has to report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from fit_material.shaders.tone_mapping import srgb

CLEARLY_ABOVE = 1.15  # colours that are more than noise about white


FEW_CUT, MANY_CUT = (
    0.01,
    0.05,
)  # share of such texels, from which it is reported, and from which colours are undetermined


@dataclass(frozen=True)
class ColorMap:
    """A texture that was found.

    Attributes:
        color: linear Rec. 709, in [0, 1], [h, w, 3]; without holes.
        photographs: how many see each texel.
        scatter: of the photographs about it before colours were cut at 1, relative.
        cut: share of the texels seen of which a channel was `CLEARLY_ABOVE` it.
    """

    color: Float[np.ndarray, "h w 3"]
    photographs: Int[np.ndarray, "h w"]
    scatter: float
    cut: float

    @property
    def mean(self) -> tuple[float, float, float]:
        """Of the texels that a photograph sees."""
        seen = self.photographs > 0
        red, green, blue = self.color[seen if seen.any() else ...].reshape(-1, 3).mean(0).tolist()
        return red, green, blue

    @property
    def sentence(self) -> str:
        """Remarks on it."""
        height, width = self.photographs.shape
        seen, often = (int((self.photographs >= least).sum()) for least in (1, 2))
        told = (
            f"The colour map has {width} × {height} texels; {seen} of them are seen, {often} by two photographs or"
            f" more; pixels scatter by {self.scatter:.2g} of their radiance about it."
        )
        if self.cut > FEW_CUT:
            told += (
                f" Colours of {self.cut:.0%} of these texels would have to be far above 1, and were cut there: the"
                " object seems to send more light than it receives, so that exposures, environment or type are wrong."
            )
        return told


def codes(color: Float[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Linear colours as sRGB in 8 bits."""
    return np.round(255 * srgb(torch.from_numpy(color)).numpy()).astype(np.uint8)
