"""What an integrator of light through microfacet lobes is given, and its interface."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.compute import chebyshev
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.shaders.optics.microfacets import Distribution

Progress = Callable[[float], None]

SHARED_SPAN = 1.6  # factor between the widths that share directions: their weights differ by its square at most


@dataclass(frozen=True)
class LobeGrid:
    """Microfacet lobes at Chebyshev nodes of log α.

    Attributes:
        low, high: ends of the range of α; both are nodes.
        count: number of nodes.
        distribution: "ggx" or "beckmann".
    """

    low: float
    high: float
    count: int
    distribution: Distribution

    @property
    def alphas(self) -> list[float]:
        """The nodes, ascending."""
        return chebyshev.levels(self.low, self.high, self.count, "log")

    @cached_property
    def groups(self) -> list[list[float]]:
        """The nodes in groups that share directions, drawn for the middle of each group."""
        groups: list[list[float]] = []
        for alpha in self.alphas:
            if groups and alpha <= groups[-1][0] * SHARED_SPAN:
                groups[-1].append(alpha)
            else:
                groups.append([alpha])
        return groups


@dataclass(frozen=True)
class Integration:
    """How lobes are integrated over the light.

    Attributes:
        degree: number of functions in the reflectance basis.
        samples: directions per pixel and lobe, a multiple of 4.
        seed: of the samples' shifts; the same seed gives the same integrals.
    """

    degree: int
    samples: int
    seed: int


@dataclass(frozen=True)
class StratifiedPixels:
    """Pixels whose rays run through equally many strata.

    Attributes:
        surface: [p, k] rays inside each of p pixels, all on the front of the object.
        numbers: of the pixels; their random numbers follow from them and the seed.
        strata: along each side of the pixels, see `pixel_footprint.strata_of`.
    """

    surface: GBuffer
    numbers: Int[Tensor, " p"]
    strata: int

    def __len__(self) -> int:
        return len(self.numbers)


class Integrator(ABC):
    """A way to integrate light through the lobes of a grid."""

    @abstractmethod
    def integrals(
        self,
        pixels: StratifiedPixels,
        environment: Environment,
        occluder: Occluder | None,
        lobes: LobeGrid,
        integration: Integration,
        progress: Progress,
    ) -> Float[Tensor, "2 a p b 3"]:
        """Light through each lobe, weighted by each function of the reflectance basis.

        Args:
            pixels: where it arrives.
            environment: the light.
            occluder: blocks some of it; None where nothing does.
            lobes: by which it is weighted.
            integration: samples, and the degree of the basis.
            progress: called with the fraction done, in (0, 1].

        Returns:
            two independent halves of the samples, lobe, pixel, function of the basis, channel; on the CPU.
        """
