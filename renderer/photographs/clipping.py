"""Which pixels of an image may be wrong because a sensor or a code was at its end."""

from __future__ import annotations

import torch
from jaxtyping import Bool
from torch import Tensor

from fit_material.renderer.images.image_file import Image

BLOCK = 8  # pixels; JPEG spreads the error of one over its block
DEMOSAICED = 3  # pixels; so far colours are mixed where each photosite has seen one


def clipped_pixels(image: Image) -> Bool[Tensor, "h w"]:
    """Pixels near white and their neighbours: those chosen by their own noise alone would bias the fit."""
    if image.full is not None:
        return dilated(torch.from_numpy(image.full), DEMOSAICED)
    radiance = torch.from_numpy(image.radiance)
    if image.white is None:
        return torch.zeros(radiance.shape[:2], dtype=torch.bool)
    return dilated((radiance >= image.white).any(-1), BLOCK if image.lossy else 1)


def dilated(mask: Bool[Tensor, "h w"], reach: int) -> Bool[Tensor, "h w"]:
    """Pixels with a masked one at most `reach` rows and columns away.

    By few shifts of the whole mask, each as far as the one before allows: scipy's filter takes ten times as long, which
    of large photographs was a quarter of all, and pooling or kornia's dilation hold copies of them.
    """
    for axis in (0, 1):
        reached = 0
        while reached < reach:
            step = min(reached + 1, reach - reached)  # further would leave gaps beside what the border cuts off
            mask, reached = _with_shifts(mask, step, axis), reached + step
    return mask


def _with_shifts(mask: Bool[Tensor, "h w"], step: int, axis: int) -> Bool[Tensor, "h w"]:
    """The mask, and with it the mask moved by a step either way."""
    size, grown = mask.shape[axis], mask.clone()
    step = min(step, size)
    grown.narrow(axis, step, size - step).logical_or_(mask.narrow(axis, 0, size - step))
    grown.narrow(axis, 0, size - step).logical_or_(mask.narrow(axis, step, size - step))
    return grown
