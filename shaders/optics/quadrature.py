"""Gauss rules and the integration of rough dielectrics over their microfacets, in float64."""

from __future__ import annotations

import functools
import math
from array import array
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.optics.microfacets import Distribution

Rule = tuple[Float[Tensor, " q"], ...]
"""Nodes, in one or more coordinates, and weights."""


def computed_once(rule: Callable[..., Rule], *arguments: object) -> Callable[[], Rule]:
    """A function that computes a rule at its first call and keeps it.

    The first call may come inside a derivative of torch.func, to which every tensor computed there belongs, and outside
    of which it is of no use. So numbers are kept, as a tensor over them, which belongs to nothing.
    """

    @functools.cache
    def kept() -> Rule:
        numbers = (array("d", each.tolist()) for each in rule(*arguments))
        return tuple(torch.frombuffer(each, dtype=torch.float64) for each in numbers)

    return kept


def _gauss(
    diagonal: Float[Tensor, " n"], beside: Float[Tensor, " n-1"]
) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
    """Nodes, ascending, and weights, of sum 1, from the recurrence of orthonormal polynomials [Golub & Welsch 1969]."""
    nodes, vectors = torch.linalg.eigh(diagonal.diag() + beside.diag(1) + beside.diag(-1))
    return nodes, vectors[0] ** 2


def _orders(count: int) -> Float[Tensor, " count-1"]:
    return torch.arange(1, count, dtype=torch.float64)


def legendre(count: int) -> tuple[Float[Tensor, " count"], Float[Tensor, " count"]]:
    """Gauss–Legendre nodes and weights on [0, 1]."""
    k = _orders(count)
    x, weight = _gauss(k.new_zeros(count), k / (4 * k**2 - 1).sqrt())
    return (x + 1) / 2, weight


def half_disc(rings: int, spokes: int) -> tuple[Float[Tensor, " q"], Float[Tensor, " q"], Float[Tensor, " q"]]:
    """u1, u2 and weights over the right half of a disc of radius √u1; √u1 = sin t makes a hemisphere over it smooth."""
    t, weight = legendre(rings)
    t = math.pi / 2 * t
    u2 = ((torch.arange(spokes) + 0.5) / spokes - 0.5) / 2
    weight = math.pi / 2 * weight * torch.sin(2 * t) / spokes
    return (t.sin() ** 2).repeat_interleave(spokes), u2.double().repeat(rings), weight.repeat_interleave(spokes)


def slope_plane(along: int, across: int) -> tuple[Float[Tensor, " q"], Float[Tensor, " q"], Float[Tensor, " q"]]:
    """x in [0, 1], y > 0 and weights: Gauss–Legendre in x, Gauss–Hermite in y."""
    x, weight_x = legendre(along)
    y, weight_y = _gauss(weight_x.new_zeros(across), (_orders(across) / 2).sqrt())
    y, weight_y = y[across // 2 :], weight_y[across // 2 :]
    return x.repeat_interleave(len(y)), y.repeat(along), torch.outer(x * 0 + weight_x, weight_y).flatten()


def facets_and_rotations(
    facets: int, rotations: int, distribution: Distribution
) -> tuple[Float[Tensor, " q"], Float[Tensor, " q"], Float[Tensor, " q"]]:
    """s² = tan²/α² of facets, s cos ψ for rotations ψ about them, and weights of sum 1 for D(h) (n·h) dω_h dψ."""
    squared, weight = _squared_slopes(facets, distribution)
    rotation, even = legendre(rotations)
    sideways = torch.outer(squared.sqrt(), torch.cos(math.pi / 2 * rotation))
    return squared.repeat_interleave(rotations), sideways.flatten(), torch.outer(weight, even).flatten()


def _squared_slopes(count: int, distribution: Distribution) -> tuple[Float[Tensor, " q"], Float[Tensor, " q"]]:
    """tan²/α² of microfacets, and weights for D(h) (n·h) dω_h, whose sum is 1."""
    if distribution == "beckmann":
        return _gauss(2 * torch.arange(count, dtype=torch.float64) + 1, _orders(count))  # Laguerre's
    t, weight = legendre(count)
    t = math.pi / 2 * t
    return t.tan() ** 2, math.pi / 2 * weight * torch.sin(2 * t)
