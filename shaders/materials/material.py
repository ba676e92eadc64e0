"""The interface of all types of material, so that no code need branch on the type."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Self

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.kinds import OfKind
from fit_material.shaders.materials.lobes import MicrofacetLobe, ThesisLobe
from fit_material.shaders.materials.widths import Width
from fit_material.shaders.optics.microfacets import Distribution

MaterialReflectance = Callable[[Any, Float[Tensor, "*p 1"]], Float[Tensor, "*p c"]]
"""F of a material by a cosine, for one or three channels."""


class AbstractMaterial(OfKind, ABC):
    """A type of material: lobes, and the formulas of its reflectance.

    Its fields are the quantities that `kind.stored` lists, each a tensor of that name, and `width` if it mirrors.

    Attributes:
        width: of the specular lobe; None where there is none.
        color: of the diffuse body; None where there is none.
    """

    width: Width | None
    color: Float[Tensor, "*p 3"] | None

    @property
    def numbers(self) -> dict[str, Tensor]:
        """All that makes it up, by the quantities' names: those stored, and the width of its lobe."""
        found = {each.name: getattr(self, each.name) for each in self.kind.stored}
        return found if self.width is None else {**found, self.width.quantity.name: self.width.value}

    @staticmethod
    @abstractmethod
    def reflectance_formula(asked: str, microfacets: bool) -> str:
        """Name of the formula of its reflectance, where that one was requested.

        Args:
            asked: one of `fresnel_models.REFLECTANCES`.
            microfacets: whether the lobe is one of these, and not the thesis's blur.
        """

    @property
    @abstractmethod
    def f0(self) -> Float[Tensor, "3"] | None:
        """Reflectance at normal incidence, per channel; None of a material that mirrors nothing."""

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
            reflectance: of metals; the others have Schlick's, whichever is requested.
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
    def with_color(self, color: Float[Tensor, "*p 3"]) -> Self:
        """The material with a body of that colour; one without a body, unchanged."""

    @abstractmethod
    def with_width(self, width: Width) -> Self:
        """The material with a specular lobe of that width; one that mirrors nothing, unchanged."""
