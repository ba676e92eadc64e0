"""The picture of a set of pixels as a function of what they are made of: the models that a fit can use."""

from __future__ import annotations

import functools
import operator
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import assert_never

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.direct_light import DirectLight
from fit_material.renderer.light_sampling import fresnel_basis
from fit_material.renderer.light_tables import irradiance_table, light_table
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.shaders.lights import Light
from fit_material.shaders.materials.fresnel_models import exact_reflectance, viewer_reflectance
from fit_material.shaders.materials.lobes import Diffuse, Factor, MicrofacetLobe, Specular
from fit_material.shaders.materials.material import MaterialReflectance
from fit_material.shaders.materials.types import Material
from fit_material.shaders.optics import microfacets
from fit_material.shaders.shade import Illumination, Points, shade


class PixelModel(ABC):
    """Radiance of every pixel, float64, by material.

    Attributes:
        table: reflected light by roughness; None where no specular lobe is to be evaluated.
    """

    table: LightTable | None

    @abstractmethod
    def radiance(self, material: Material) -> Float[Tensor, "p 3"]: ...

    @abstractmethod
    def under(self, table: LightTable | None) -> PixelModel:
        """The same pixels with another table."""

    def half(self, which: int) -> PixelModel:
        """The same pixels with one half of the table's samples."""
        return self if self.table is None else self.under(self.table.half(which))

    def rounded(self) -> PixelModel:
        """The same pixels with the table as another processor might have rounded it."""
        return self if self.table is None else self.under(self.table.rounded())

    def without_highest_level(self) -> PixelModel | None:
        """The same pixels with less light than they lose to interpolation between levels; None where there is none."""
        if self.table is None or self.table.light.shape[1] == 1:
            return None
        return self.under(self.table.without_highest())


class MixedPixels(PixelModel):
    """Pixels whose radiance may be a sum of numbers that do not depend on the material, Σ_q mixed · u."""

    @abstractmethod
    def mixing(self, material: Material) -> Float[Tensor, "q 3"] | None:
        """u, how much each number of `mixed` counts; None of a material whose picture is more than their sum."""

    @abstractmethod
    def mixed(self, pixels: slice) -> Float[Tensor, "p q 3"]:
        """What is mixed, of some pixels."""


@dataclass(frozen=True)
class Body:
    """Light that a diffuse body under each pixel receives.

    Attributes:
        light: D_b of `irradiance_table.diffuse_table`, [p, b, 3].
        view: means of `irradiance_table.cosine_basis` at n·v over the pixel's rays, [p, b].
    """

    light: Float[Tensor, "p b 3"]
    view: Float[Tensor, "p b"]

    def seen(self, towards_view: Factor, towards_light: Factor) -> Float[Tensor, "p 3"]:
        """Light that passes twice: by a factor of n·l on its way in, by one of n·v on its way out."""
        factors = dict.fromkeys((towards_light, towards_view))  # one where they are the same: it takes long to compute
        found = [irradiance_table.coefficients(factor, self.view, self.view.shape[1]) for factor in factors]
        inwards, outwards = found[0], found[-1]
        return (self.light * inwards).sum(1) * (self.view @ outwards)


@dataclass(frozen=True)
class ExactPixels(MixedPixels):
    """Microfacets with exact Fresnel reflectance; below a dielectric's, light that is scattered inside [MODEL.md 6].

    Attributes:
        table: of `transport.microfacet_table`.
        light: its mean.
        body: the diffuse light; None where there is nothing to scatter it.
        sources: lights beside the environment.
        distribution: of the microfacets.
        reflectance: of each facet.
        highlights: whether the facets mirror these lights.
    """

    table: LightTable | None
    light: Float[Tensor, "a p b 3"] | None
    body: Body | None
    sources: tuple[DirectLight, ...]
    distribution: microfacets.Distribution
    reflectance: MaterialReflectance = exact_reflectance
    highlights: bool = True

    @property
    def mirrored(self) -> tuple[DirectLight, ...]:
        """The lights beside the environment that the facets mirror."""
        return self.sources if self.highlights else ()

    def under(self, table: LightTable | None) -> ExactPixels:
        return replace(self, table=table, light=None if table is None else table.mean(torch.float64))

    def radiance(self, material: Material) -> Float[Tensor, "p 3"]:
        """Radiance of every pixel: the sum over the material's lobes."""
        return functools.reduce(operator.add, map(self._lobe, self._lobes(material)))

    def sent_by_body(self, material: Material) -> Float[Tensor, "p 3"]:
        """Light from the diffuse body, which needs no table."""
        diffuse = (lobe for lobe in self._lobes(material) if isinstance(lobe, Diffuse))
        return functools.reduce(operator.add, map(self._lobe, diffuse))

    def _lobes(self, material: Material) -> tuple[MicrofacetLobe, ...]:
        return material.microfacet_lobes(self.distribution, self.reflectance)

    def _lobe(self, lobe: MicrofacetLobe) -> Float[Tensor, "p 3"]:
        if isinstance(lobe, Specular):
            return self.reflected(lobe.reflectance, lobe.alpha)
        if isinstance(lobe, Diffuse):
            return lobe.albedo * self.scattered(lobe.leaving, lobe.entering)
        assert_never(lobe)

    def mixing(self, material: Material) -> Float[Tensor, "q 3"] | None:
        """Level weights times Fresnel coefficients, for one specular lobe that the environment alone falls on."""
        if material.has_body or self.mirrored or self.light is None or self.table is None:
            return None
        (lobe,) = self._lobes(material)
        assert isinstance(lobe, Specular)
        coefficients = self._coefficients(lobe.reflectance, lobe.alpha)
        return (self.table.level_weights(lobe.alpha)[:, None, None] * coefficients).flatten(0, 1)

    def mixed(self, pixels: slice) -> Float[Tensor, "p q 3"]:
        """The table's light."""
        assert self.light is not None
        return self.light[:, pixels].movedim(0, 1).flatten(1, 2)

    def _coefficients(self, reflectance: Factor, like: Tensor) -> Float[Tensor, "b c"]:
        assert self.light is not None
        return fresnel_basis.coefficients(reflectance, self.light.shape[2], like)

    def reflected(self, reflectance: Factor, alpha: Float[Tensor, ""]) -> Float[Tensor, "p 3"]:
        """Light that the microfacets mirror."""
        assert self.table is not None
        assert self.light is not None
        weights = self.table.level_weights(alpha)
        found = light_table.radiance(self.light, weights, self._coefficients(reflectance, alpha))
        for source in self.mirrored:
            found = found + source.reflected(reflectance, alpha, self.distribution)
        return found

    def scattered(self, towards_view: Factor, towards_light: Factor = torch.ones_like) -> Tensor:
        """Light that a white body sends back, [p, 3]; see `Body.seen`."""
        assert self.body is not None
        found = self.body.seen(towards_view, towards_light)
        for source in self.sources:
            found = found + source.scattered(towards_view, towards_light)
        return found


@dataclass(frozen=True)
class BlurredByTable(Illumination):
    """The thesis's light at a set of pixels, its blur taken from a table.

    Attributes:
        table: of `transport.tap_table`, None where nothing is mirrored.
        mean: its light, [a, p, 3].
    """

    table: LightTable | None
    mean: Float[Tensor, "a p 3"] | None
    ambient: Float[Tensor, "9 3"]
    sources: tuple[Light, ...] = ()

    def blurred(self, r: Float[Tensor, "p 3"], rho: Float[Tensor, ""]) -> Float[Tensor, "p 3"]:
        assert self.table is not None
        assert self.mean is not None
        return torch.tensordot(self.table.level_weights(rho), self.mean, dims=1)


@dataclass(frozen=True)
class ViewerPixels(PixelModel):
    """The thesis's model as the viewer draws it, at the pixels' centres [MODEL.md 3, 4].

    Attributes:
        reflectance: of metals; the thesis's is `viewer_reflectance`.
    """

    points: Points
    illumination: BlurredByTable
    reflectance: MaterialReflectance = viewer_reflectance

    @property
    def table(self) -> LightTable | None:  # type: ignore[override]
        return self.illumination.table

    def under(self, table: LightTable | None) -> ViewerPixels:
        mean = None if table is None else table.mean(torch.float64)[:, :, 0]
        return replace(self, illumination=replace(self.illumination, table=table, mean=mean))

    def radiance(self, material: Material) -> Float[Tensor, "p 3"]:
        """Radiance of every pixel; a metal's by the chosen reflectance."""
        return shade(material, self.points, self.illumination, self.reflectance)


def exact_pixels(
    surface: GBuffer,
    diffuse: Float[Tensor, "p b 3"] | None,
    sources: Sequence[Light],
    distribution: microfacets.Distribution,
    reflectance: MaterialReflectance,
    occluder: Occluder | None = None,
    highlights: bool = True,
) -> ExactPixels:
    """The dearer model of pixels, without a table so far.

    Args:
        surface: [p, k] rays inside each pixel.
        diffuse: `Body.light`; None where there is nothing to scatter it.
        sources: lights beside the environment.
        distribution: of the microfacets.
        reflectance: of each facet.
        occluder: what may stand before the sources; None where nothing does.
        highlights: whether the facets mirror the sources.
    """
    direct = tuple(DirectLight.of(surface, source, occluder) for source in sources)
    if diffuse is None:
        return ExactPixels(None, None, None, direct, distribution, reflectance, highlights)
    view = irradiance_table.cosine_basis(surface.n_dot_v, diffuse.shape[1]).mean(1)
    body = Body(diffuse.double(), view)
    return ExactPixels(None, None, body, direct, distribution, reflectance, highlights)


def viewer_pixels(
    surface: GBuffer,
    ambient: Float[Tensor, "9 3"],
    sources: Sequence[Light],
    reflectance: MaterialReflectance,
    openness: Float[Tensor, "p 1"] | None = None,
) -> ViewerPixels:
    """The viewer's model of pixels, seen at their central rays, without a table so far."""
    centre = central(surface)
    light = BlurredByTable(None, None, ambient, tuple(sources))
    open_ = None if openness is None else openness.nan_to_num(1.0)
    return ViewerPixels(Points(centre.normal, centre.view, open_, None, centre.position), light, reflectance)


def central(surface: GBuffer) -> GBuffer:
    """The ray in the middle of each pixel, [p]."""
    return surface[:, surface.hit.shape[1] // 2]
