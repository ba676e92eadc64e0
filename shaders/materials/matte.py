"""Matte materials."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.kinds import MATTE
from fit_material.shaders.materials.lobes import Diffuse, MicrofacetLobe, ThesisLobe
from fit_material.shaders.materials.material import AbstractMaterial, MaterialReflectance
from fit_material.shaders.materials.widths import Width
from fit_material.shaders.optics import fresnel
from fit_material.shaders.optics.microfacets import Distribution


@dataclass(frozen=True)
class Matte(AbstractMaterial):
    """A surface without reflections.

    Attributes:
        color: in [0, 1].
        reflectance: how much of it is seen from the front, in [0, 1]; at 1 the surface is Lambertian.
        width: none.
    """

    color: Float[Tensor, "*p 3"]
    reflectance: Float[Tensor, "3"]

    kind = MATTE
    width: ClassVar[None] = None

    @staticmethod
    def reflectance_formula(asked: str, microfacets: bool) -> str:
        return "schlick"

    @property
    def f0(self) -> None:
        return None

    @property
    def dtype(self) -> torch.dtype:
        return self.color.dtype

    def microfacet_lobes(
        self, distribution: Distribution, reflectance: MaterialReflectance
    ) -> tuple[MicrofacetLobe, ...]:
        return (Diffuse(self.color, entering=torch.ones_like, leaving=functools.partial(reflectance, self)),)

    def thesis_lobes(
        self, reflectance: MaterialReflectance, tint: Float[Tensor, "*p 3"] | None = None
    ) -> tuple[ThesisLobe, ...]:
        color = self.color if tint is None else self.color * tint
        return (Diffuse(color, entering=torch.ones_like, leaving=self.schlick_reflectance),)

    def exact_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return self.schlick_reflectance(cosine)

    def viewer_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return self.schlick_reflectance(cosine)

    def schlick_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return fresnel.schlick(cosine, self.reflectance)

    def albedo(self, distribution: Distribution) -> Float[Tensor, "*p 3"]:
        """Its colour, as if it were Lambertian."""
        return self.color

    def with_color(self, color: Float[Tensor, "*p 3"]) -> Matte:
        return replace(self, color=color)

    def with_width(self, width: Width) -> Matte:
        return self
