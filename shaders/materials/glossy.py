"""Glossy materials: dielectrics."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.kinds import GLOSSY
from fit_material.shaders.materials.lobes import Blurred, Diffuse, MicrofacetLobe, Specular, ThesisLobe
from fit_material.shaders.materials.material import AbstractMaterial, MaterialReflectance
from fit_material.shaders.materials.widths import Width, alpha_of, rho_of
from fit_material.shaders.optics import diffuse, fresnel, rough_plastic
from fit_material.shaders.optics.microfacets import Distribution
from fit_material.shaders.optics.quadrature import legendre

COSINES = 16  # of a Gauss–Legendre rule, by which means over all sides are known to a ten-thousandth


@dataclass(frozen=True)
class Glossy(AbstractMaterial):
    """A dielectric: a diffuse body under a reflecting surface.

    Attributes:
        color: of the body, in [0, 1].
        reflectance: of the surface at normal incidence, in [0, 1].
        width: as a `Metal`'s.
    """

    color: Float[Tensor, "*p 3"]
    reflectance: Float[Tensor, "3"]
    width: Width

    kind = GLOSSY

    @staticmethod
    def reflectance_formula(asked: str, microfacets: bool) -> str:
        return "dielectric" if microfacets and asked == "conductor" else "schlick"

    @property
    def f0(self) -> Float[Tensor, "3"]:
        return self.reflectance

    @property
    def dtype(self) -> torch.dtype:
        return self.color.dtype

    @property
    def ior(self) -> Float[Tensor, ""]:
        """Index of refraction η of a surface that mirrors all channels alike, by the first."""
        return rough_plastic.ior(self.reflectance[0])

    def microfacet_lobes(
        self, distribution: Distribution, reflectance: MaterialReflectance
    ) -> tuple[MicrofacetLobe, ...]:
        """The surface, and light from below a rough dielectric, as Mitsuba's `roughplastic` has it.

        f = color · outcoupling · T(n·l) T(n·v) / π        [`shaders.optics.rough_plastic`]
        """
        eta, alpha = self.ior, alpha_of(self.width)

        def passed(cosine: Tensor) -> Tensor:
            return rough_plastic.transmittance(cosine, eta, alpha, distribution)

        albedo = self.color * rough_plastic.outcoupling(eta, alpha, distribution)
        surface = Specular(functools.partial(reflectance, self), alpha)
        return surface, Diffuse(albedo, entering=passed, leaving=passed)

    def thesis_lobes(
        self, reflectance: MaterialReflectance, tint: Float[Tensor, "*p 3"] | None = None
    ) -> tuple[ThesisLobe, ...]:
        """The surface, and below it the colour that `energy_guard` leaves beside the mirrored light."""
        color = self.color if tint is None else self.color * tint

        def guarded(n_dot_v: Tensor) -> Tensor:
            f = self.schlick_reflectance(n_dot_v)
            return diffuse.energy_guard(color.expand(f.shape), f)

        white = torch.ones_like(self.reflectance)
        return Blurred(self.schlick_reflectance, rho_of(self.width)), Diffuse(white, torch.ones_like, guarded)

    def exact_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 1"]:
        """Fresnel's reflectance of a dielectric with one index for all channels."""
        return fresnel.dielectric(cosine, self.ior)

    def viewer_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return self.schlick_reflectance(cosine)

    def schlick_reflectance(self, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
        return fresnel.schlick(cosine, self.reflectance)

    def albedo(self, distribution: Distribution) -> Float[Tensor, "*p 3"]:
        """Albedo under uniform light.

        color · outcoupling · T̄² + R̄,   T̄ = 2 ∫ T(µ) µ dµ, and R̄ like that        [`shaders.optics.rough_plastic`]
        """
        eta, alpha = self.ior, alpha_of(self.width)
        cosine, weight = legendre(COSINES)
        passed, mirrored = (
            2 * (share(cosine, eta, alpha, distribution) * cosine * weight).sum()
            for share in (rough_plastic.transmittance, rough_plastic.reflectance)
        )
        return self.color * passed**2 * rough_plastic.outcoupling(eta, alpha, distribution) + mirrored

    def with_color(self, color: Float[Tensor, "*p 3"]) -> Glossy:
        return replace(self, color=color)

    def with_width(self, width: Width) -> Glossy:
        return replace(self, width=width)
