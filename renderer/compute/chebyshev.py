"""Chebyshev interpolation on an interval: the smooth way to store a curve by a handful of its values."""

from __future__ import annotations

import functools
import math
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

Scale = Literal["linear", "log"]


def nodes(count: int) -> Float[Tensor, " count"]:
    """The `count` extrema of a Chebyshev polynomial, ascending from -1 to 1 (0 for a single node), float64."""
    if count == 1:
        return torch.zeros(1, dtype=torch.float64)
    return -torch.cos(math.pi * torch.arange(count, dtype=torch.float64) / (count - 1))


def levels(low: float, high: float, count: int, scale: Scale) -> list[float]:
    """The nodes of a positive quantity, or of its logarithm, from `low` to `high`, ends included."""
    first, last = on_scale(torch.tensor([low, high], dtype=torch.float64), scale)
    placed = first + (nodes(count) + 1) / 2 * (last - first)
    return (placed.exp() if scale == "log" else placed).tolist()


def on_scale(value: Tensor, scale: Scale) -> Tensor:
    """The value, or its logarithm."""
    return value.log() if scale == "log" else value


def polynomials(x: Float[Tensor, "..."], count: int) -> Float[Tensor, "count ..."]:
    """T_0(x) … T_{count-1}(x) by their recurrence T_{j+1} = 2x T_j - T_{j-1}, for x in [-1, 1]."""
    values = [torch.ones_like(x), x]
    while len(values) < count:
        values.append(2 * x * values[-1] - values[-2])
    return torch.stack(values[:count])


def coefficients(values: Float[Tensor, "count ..."]) -> Float[Tensor, "count ..."]:
    """Coefficients c_j with Σ_j c_j T_j(x) equal to `values` at `nodes(count)`."""
    return torch.tensordot(_at_extrema(len(values)).to(values), values, dims=1)


def weights(x: Float[Tensor, ""], count: int) -> Float[Tensor, " count"]:
    """Weights w with f(x) ≈ Σ_j w_j f(node_j); differentiable with respect to x."""
    return _at_extrema(count).T.to(x) @ polynomials(x, count)


def analysis(places: Float[Tensor, " count"]) -> Float[Tensor, "count count"]:
    """The matrix from values at any different places in [-1, 1] to coefficients."""
    return torch.linalg.inv(polynomials(places, len(places)).T)


@functools.cache
def _at_extrema(count: int) -> Float[Tensor, "count count"]:
    """The same of `nodes(count)`, float64; cached."""
    return analysis(nodes(count))
