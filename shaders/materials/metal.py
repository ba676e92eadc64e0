"""Metals."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.lobes import Blurred, MicrofacetLobe, Specular, ThesisLobe
from fit_material.shaders.materials.material import AbstractMaterial, MaterialReflectance
from fit_material.shaders.optics import fresnel
from fit_material.shaders.optics.microfacets import Distribution


@dataclass(frozen=True)
class Metal(AbstractMaterial):
    """A metal: reflects, with colour, and does nothing else.

    Attributes:
        n, k: complex refractive index per channel, n > 0, k >= 0.
        roughness: blur radius ρ >= 0; where the lobe in use is a microfacet one, its width alpha.
        color: none.
    """

    n: Float[Tensor, "3"]
    k: Float[Tensor, "3"]
    roughness: Float[Tensor, ""]

    type: ClassVar[Literal["metal"]] = "metal"
    noun = "a metal"
    mirrors = True
    has_body = False
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
        return (Specular(functools.partial(reflectance, self), self.roughness),)

    def thesis_lobes(
        self, reflectance: MaterialReflectance, tint: Float[Tensor, "*p 3"] | None = None
    ) -> tuple[ThesisLobe, ...]:
        return (Blurred(functools.partial(reflectance, self), self.roughness),)

    def exact_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return fresnel.conductor(cosine, self.n, self.k)

    def viewer_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return fresnel.lazanyi(cosine, self.n, self.k)

    def schlick_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return fresnel.schlick(cosine, self.f0)

    def albedo(self, distribution: Distribution) -> Float[Tensor, "3"]:
        """F0, above which the mean over all sides is by (1 - F0)/21 [Schlick 1994, eq. 15, integrated]."""
        return self.f0

    def with_width_times(self, factor: float) -> Metal:
        return replace(self, roughness=factor * self.roughness)
