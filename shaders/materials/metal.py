"""Metals."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.kinds import METAL
from fit_material.shaders.materials.lobes import Blurred, MicrofacetLobe, Specular, ThesisLobe
from fit_material.shaders.materials.material import AbstractMaterial, MaterialReflectance
from fit_material.shaders.materials.widths import Width, alpha_of, rho_of
from fit_material.shaders.optics import fresnel
from fit_material.shaders.optics.microfacets import Distribution


@dataclass(frozen=True)
class Metal(AbstractMaterial):
    """A metal: reflects, with colour, and does nothing else.

    Attributes:
        n, k: complex refractive index per channel, n > 0, k >= 0.
        width: of the specular lobe, as the model in use has it.
        color: none.
    """

    n: Float[Tensor, "3"]
    k: Float[Tensor, "3"]
    width: Width

    kind = METAL
    color: ClassVar[None] = None

    @staticmethod
    def reflectance_formula(asked: str, microfacets: bool) -> str:
        return asked

    @property
    def f0(self) -> Float[Tensor, "3"]:
        return fresnel.normal_reflectance(self.n, self.k)

    @property
    def dtype(self) -> torch.dtype:
        return self.n.dtype

    def microfacet_lobes(
        self, distribution: Distribution, reflectance: MaterialReflectance
    ) -> tuple[MicrofacetLobe, ...]:
        return (Specular(functools.partial(reflectance, self), alpha_of(self.width)),)

    def thesis_lobes(
        self, reflectance: MaterialReflectance, tint: Float[Tensor, "*p 3"] | None = None
    ) -> tuple[ThesisLobe, ...]:
        return (Blurred(functools.partial(reflectance, self), rho_of(self.width)),)

    def exact_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return fresnel.conductor(cosine, self.n, self.k)

    def viewer_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return fresnel.lazanyi(cosine, self.n, self.k)

    def schlick_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return fresnel.schlick(cosine, self.f0)

    def albedo(self, distribution: Distribution) -> Float[Tensor, "3"]:
        """F0, above which the mean over all sides is by (1 - F0)/21 [Schlick 1994, eq. 15, integrated]."""
        return self.f0

    def with_color(self, color: Float[Tensor, "*p 3"]) -> Metal:
        return self

    def with_width(self, width: Width) -> Metal:
        return replace(self, width=width)
