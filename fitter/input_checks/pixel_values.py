"""Findings that a photograph's own numbers bring: clipped, or of few values."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.input_checks.finding import Finding, percent
from fit_material.fitter.observations.photograph import Photograph

CLIPPED = 0.05  # of the object's pixels, from which highlights determine too little; 2 % is what good exposures have
AT_TOP = 0.99  # of the largest value: two codes of 255
FLAT = 0.02  # of the object's pixels that share the very largest value: in floats no light does that
VALUES = 24  # different values of a channel; 8 bits have 256, and the relative error of 24 is 4 %
CONTRAST = 1.1  # between a channel's quartiles or the largest value; a matte ball in even light has none
MOST = 20_000  # pixels looked at, of more every second, third …
ENOUGH = 400  # pixels, from which such statistics are meaningful


def pixel_findings(photograph: Photograph, inside: Bool[Tensor, "h w"], where: str) -> list[Finding]:
    """What is wrong with one photograph's pixels; `inside` is where the object is."""
    pixels = photograph.radiance[inside]
    if len(pixels) < ENOUGH:
        return []
    pixels = pixels[:: max(1, len(pixels) // MOST)]
    if photograph.clipped:
        clipped = _at_top(pixels, AT_TOP)
        if clipped > CLIPPED:
            value = f"{percent(clipped)} of the object's pixels are clipped, of which a fit learns little"
            remedy = "expose less, or give several exposures as images = [ … ]"
            return [Finding("clipping", where, value, remedy)]
    elif (clipped := _at_top(pixels, 1.0)) > FLAT and _contrast(pixels, 1.0) > CONTRAST:
        value = f"{percent(clipped)} of the object's pixels have the very same largest value, {float(pixels.max()):.3g}"
        remedy = "they are clipped without a mark: export without clipping, or mask them out"
        return [Finding("clipping", where, value, remedy)]
    values = max(len(torch.unique(channel)) for channel in pixels.T)
    if values < VALUES and _contrast(pixels, 0.75) > CONTRAST:
        value = f"the object's pixels have {values} different values"
        return [Finding("values", where, value, "expose more, or export with more bits")]
    return []


def _at_top(pixels: Float[Tensor, "p 3"], share: float) -> float:
    """How many pixels have a channel that is as large as that share of its largest value."""
    top = pixels.amax(0)
    return float(((pixels >= share * top) & (top > 0)).any(-1).double().mean())


def _contrast(pixels: Float[Tensor, "p 3"], upper: float) -> float:
    """The largest ratio between that quantile of a channel and its lower quartile."""
    ordered = pixels.sort(0).values
    high, low = (ordered[round(share * (len(ordered) - 1))] for share in (upper, 0.25))
    return float((high / low.clamp_min(torch.finfo(high.dtype).tiny))[high > 0].max()) if (high > 0).any() else 1.0
