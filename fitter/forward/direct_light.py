"""Light of one source at a set of pixels: what microfacets mirror of it and what a diffuse body scatters."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.light_tables import irradiance_table
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.shaders.lights import Light
from fit_material.shaders.materials.lobes import Factor
from fit_material.shaders.optics import microfacets

DIFFUSE_DEGREE = 11  # polynomials in √cos: one more than `irradiance_table.DEGREE`, so that (1 - cos)⁵ is among them


def _interpolated(factor: Factor, cosines: Float[Tensor, "p k"]) -> Float[Tensor, "p k c"]:
    """A factor that takes long to compute, from its values at a few cosines."""
    basis = irradiance_table.cosine_basis(cosines, DIFFUSE_DEGREE)
    return basis @ irradiance_table.coefficients(factor, cosines, DIFFUSE_DEGREE)


@dataclass(frozen=True)
class DirectLight:
    """One light on the rays inside each pixel: cosines [p, k], and its irradiance on a surface that faces it.

    Attributes:
        cos_v, cos_l, cos_h: of view, light and half vector against the normal; cos_l is 0 below the horizon.
        cos_d: of the half vector against the view.
        irradiance: the largest within each pixel.
        falloff: irradiance of each ray over that, 1 of a directional light.
    """

    cos_v: Float[Tensor, "p k"]
    cos_l: Float[Tensor, "p k"]
    cos_h: Float[Tensor, "p k"]
    cos_d: Float[Tensor, "p k"]
    irradiance: Float[Tensor, "p 3"]
    falloff: Float[Tensor, "p k 3"]

    @staticmethod
    def of(surface: GBuffer, source: Light, occluder: Occluder | None = None) -> DirectLight:
        """The light on a surface; none of it where something stands before it."""
        incident = source.at(surface.position.double())
        towards = incident.towards.to(surface.normal)
        half = torch.nn.functional.normalize(surface.view + towards, dim=-1)
        cosines = ((surface.normal * towards).sum(-1), (surface.normal * half).sum(-1), (surface.view * half).sum(-1))
        cos_l, cos_h, cos_d = (cosine.clamp(0, 1) for cosine in cosines)
        if occluder is not None:
            cos_l = cos_l * occluder.free(occluder.origins(surface), towards, incident.distance)
        irradiance = math.pi * incident.radiance
        largest = irradiance.amax(1)
        falloff = irradiance / largest[:, None].clamp_min(torch.finfo(largest.dtype).tiny)
        return DirectLight(surface.n_dot_v, cos_l, cos_h.clamp_min(1e-6), cos_d, largest, falloff)

    def reflected(
        self, reflectance: Factor, alpha: Float[Tensor, ""], distribution: microfacets.Distribution
    ) -> Float[Tensor, "p 3"]:
        """E · F D G / (4 n·v), the mean over each pixel."""
        facets = microfacets.reflected(self.cos_v, self.cos_l, self.cos_h, alpha, distribution)
        return self.irradiance * (reflectance(self.cos_d[..., None]) * facets[..., None] * self.falloff).mean(1)

    def scattered(self, towards_view: Factor, towards_light: Factor) -> Float[Tensor, "p 3"]:
        """E · cos/π of a white body, by a factor of n·l on the way in and one of n·v on the way out."""
        passed = _interpolated(towards_light, self.cos_l) * _interpolated(towards_view, self.cos_v)
        return self.irradiance / math.pi * (passed * self.cos_l[..., None] * self.falloff).mean(1)

    def received(self) -> Float[Tensor, "p 3"]:
        """E · cos/π of a white Lambertian body, the mean over each pixel."""
        return (self.cos_l[..., None] * self.falloff).mean(1) * self.irradiance / math.pi
