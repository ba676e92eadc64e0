"""Widths of specular lobes: two quantities, of which no number means both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.quantities import ALPHA, ROUGHNESS, Quantity


@dataclass(frozen=True)
class Microfacet:
    """Width alpha of a distribution of microfacets, Mitsuba's, unitless; 0 is a mirror [Walter 2007, eq. 33]."""

    value: Float[Tensor, ""]

    quantity: ClassVar[Quantity] = ALPHA


@dataclass(frozen=True)
class Blur:
    """Radius ρ of the thesis's blur, the viewer's number, unitless; 0 is a mirror [thesis 3.2; MODEL.md 3]."""

    value: Float[Tensor, ""]

    quantity: ClassVar[Quantity] = ROUGHNESS


Width = Microfacet | Blur

RHO_PER_ALPHA = 2 * math.sqrt(2)  # of a narrow Beckmann lobe; a first guess for other lobes [MODEL.md 6]


def blur_like(width: Width) -> Blur:
    """The blur that is about as wide, ρ ≈ 2√2·alpha."""
    return width if isinstance(width, Blur) else Blur(RHO_PER_ALPHA * width.value)


def alpha_of(width: Width) -> Float[Tensor, ""]:
    """alpha of a lobe of microfacets.

    Raises:
        TypeError: the width is one of another lobe.
    """
    return _value(width, Microfacet)


def rho_of(width: Width) -> Float[Tensor, ""]:
    """ρ of a blurred lobe.

    Raises:
        TypeError: the width is one of another lobe.
    """
    return _value(width, Blur)


def _value(width: Width, wanted: type[Width]) -> Float[Tensor, ""]:
    if not isinstance(width, wanted):
        raise TypeError(f"a lobe by {wanted.quantity.name}, and a width that is {width.quantity.name}")
    return width.value
