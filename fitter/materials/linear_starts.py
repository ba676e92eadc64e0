"""Parts of starts: pictures are linear in colour and in F0, so that these are linear fits at each width of a table."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.renderer.compute import chebyshev
from fit_material.shaders.materials.widths import Width


def share(
    picture: Float[Tensor, "*a p 3"], photograph: Float[Tensor, "p 3"], weight: Float[Tensor, "p 3"]
) -> Float[Tensor, "*a 3"]:
    """The factor, per channel, by which a picture comes nearest to a photograph."""
    product, square = (weight**2 * picture * photograph).sum(-2), (weight**2 * picture**2).sum(-2)
    return product / square.clamp_min(torch.finfo(square.dtype).tiny)


def widths(model: PixelModel) -> list[Width]:
    """The widths of the levels of a model's table, float64."""
    table = model.table
    assert table is not None
    found = chebyshev.levels(table.low, table.high, table.light.shape[1], table.scale)
    return [table.lobe(torch.tensor(level, dtype=torch.float64)) for level in found]
