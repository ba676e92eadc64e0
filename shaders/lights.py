"""Lights beside the environment: what each sends to points of a surface."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from jaxtyping import Float
from torch import Tensor


class Incident(NamedTuple):
    """Light that arrives from one source.

    Attributes:
        towards: unit direction towards the source.
        radiance: E of MODEL.md 3.2 and 4, the irradiance on a surface that faces the source, over π.
        distance: to the source, where shadow rays end; inf of a source that is infinitely far away.
    """

    towards: Float[Tensor, "*p 3"]
    radiance: Float[Tensor, "*p 3"]
    distance: Float[Tensor, "*p"]


class Light(ABC):
    """A source that shines on each point from one direction.

    Attributes:
        kind: the `type` of `[[lights]]`, by which registries have what other layers make of it.
    """

    kind: ClassVar[str]

    @abstractmethod
    def at(self, position: Float[Tensor, "*p 3"]) -> Incident:
        """The light that arrives at points in world space, if nothing is before it; in their dtype."""


@dataclass(frozen=True)
class DirectionalLight(Light):
    """A light so far away that it shines from one direction.

    Attributes:
        towards: unit direction towards it.
        radiance: E of MODEL.md 3.2 and 4, its irradiance on a surface that faces it over π.
    """

    kind: ClassVar[str] = "directional"

    towards: Float[Tensor, "3"]
    radiance: Float[Tensor, "3"]

    def at(self, position: Float[Tensor, "*p 3"]) -> Incident:
        towards, radiance = (each.to(position).expand(position.shape) for each in (self.towards, self.radiance))
        return Incident(towards, radiance, position.new_full(position.shape[:-1], math.inf))
