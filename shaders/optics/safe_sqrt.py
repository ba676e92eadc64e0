"""The square root where its argument may reach 0, and with it the derivative infinity."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def root(x: Float[Tensor, "*p"]) -> Float[Tensor, "*p"]:
    """√x for x > 0; else 0, and so is the derivative.

    An infinite derivative becomes NaN as soon as the factor behind it is 0, which is where roots of sines and k² end.
    The value is the root's own everywhere: nothing is added to x.
    """
    positive = x > 0
    return torch.where(positive, torch.where(positive, x, 1.0).sqrt(), 0.0)
