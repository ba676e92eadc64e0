"""Lights beside the environment."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class DirectionalLight:
    """A light so far away that it shines from one direction.

    Attributes:
        towards: unit direction towards it.
        radiance: E of MODEL.md 3.2 and 4, its irradiance on a surface that faces it over π.
    """

    towards: Float[Tensor, "3"]
    radiance: Float[Tensor, "3"]
