"""What every type of material answers, so that nobody need ask for the type."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Self

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.lobes import MicrofacetLobe, ThesisLobe
from fit_material.shaders.materials.quantities import MaterialType
from fit_material.shaders.optics.microfacets import Distribution

MaterialReflectance = Callable[[Any, Float[Tensor, "*p 1"]], Float[Tensor, "*p c"]]
"""F of a material by a cosine, for one or three channels."""


class AbstractMaterial(ABC):
    """A type of material: lobes, and the formulas of its reflectance.

    Attributes:
        type: its name, as files and the command line have it.
        mirrors: whether it has a specular lobe.
        has_body: whether it has a diffuse lobe.
        same_as: quantities that are another one by a second name.
        noun: what a sentence calls it.
    """

    type: ClassVar[MaterialType]
    mirrors: ClassVar[bool]
    has_body: ClassVar[bool]
    same_as: ClassVar[Mapping[str, str]] = MappingProxyType({})
    noun: ClassVar[str]

    @staticmethod
    @abstractmethod
    def reflectance_formula(asked: str, microfacets: bool) -> str:
        """Name of the formula of its reflectance, where that one was asked for.

        Args:
            asked: one of `fresnel_models.REFLECTANCES`.
            microfacets: whether the lobe is one of these, and not the thesis's blur.
        """

    @property
    @abstractmethod
    def f0(self) -> Float[Tensor, "3"] | None:
        """Reflectance at normal incidence, per channel; None of what mirrors nothing."""

    @property
    @abstractmethod
    def dtype(self) -> torch.dtype:
        """That of its colours or indices; single numbers do not count, as in torch's own promotion."""

    @abstractmethod
    def microfacet_lobes(
        self, distribution: Distribution, reflectance: MaterialReflectance
    ) -> tuple[MicrofacetLobe, ...]:
        """Lobes of a surface of microfacets [MODEL.md 6].

        Args:
            distribution: of the microfacets' normals.
            reflectance: of each facet.
        """

    @abstractmethod
    def thesis_lobes(
        self, reflectance: MaterialReflectance, tint: Float[Tensor, "*p 3"] | None = None
    ) -> tuple[ThesisLobe, ...]:
        """Lobes as the thesis has them, whose light in and out both go by n·v [thesis 3.2; MODEL.md 4].

        Args:
            reflectance: of metals; the others have Schlick's, whichever is asked for.
            tint: multiplies the body's colour.
        """

    @abstractmethod
    def exact_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p c"]:
        """Fresnel's reflectance of a conductor or dielectric; of a body without a surface, Schlick's."""

    @abstractmethod
    def viewer_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        """Fresnel reflectance as the thesis approximates it."""

    @abstractmethod
    def schlick_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        """Schlick's approximation of Fresnel's reflectance, from that at normal incidence."""

    @abstractmethod
    def albedo(self, distribution: Distribution) -> Float[Tensor, "*p 3"]:
        """Albedo of body and surface under uniform light, in [0, 1], float64; colours may be of many places, [*p, 3].

        Args:
            distribution: of the microfacets.
        """

    @abstractmethod
    def with_width_times(self, factor: float) -> Self:
        """The material with a lobe so many times as wide; one that mirrors nothing, unchanged."""
