"""Radiance of a few pixels in every orientation of the light: all that a coarse fit needs.

Microfacets look alike from all sides, so that light that is rotated or mirrored is the same as a surface and a viewer
that are rotated or mirrored back: one integration serves every orientation, and no map has to be resampled.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.direct_light import DirectLight
from fit_material.fitter.input_checks.orientation import Orientation, about_y
from fit_material.fitter.input_checks.sampled_pixels import SampledPixels
from fit_material.renderer.environment import cubemap
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.environment.downsampling import box_filtered
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.light_sampling import fresnel_basis
from fit_material.renderer.light_sampling.integrator import Integration, LobeGrid
from fit_material.renderer.light_tables import irradiance_table
from fit_material.renderer.light_tables.light_table import microfacet_table
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.pixel_footprint import middle
from fit_material.shaders.lights import Light

COLUMNS = 1024  # of the map, at most
ALPHAS = (0.02, 0.9, 9)  # ends and number of the table's levels
TRIED = 16  # roughnesses between the ends
DEGREE = 6  # functions of the reflectance's basis: Schlick's curve to a thousandth
SAMPLES = 128
DIFFUSE_DEGREE = 6
FACE = 12  # texels along a face of the diffuse light's cube: a cosine is interpolated to 2e-3
PLASTIC = 0.04


@dataclass(frozen=True)
class Pictures:
    """Radiance of each pixel under unit reflectances; o orientations, a roughnesses, p pixels.

    Attributes:
        white: of a perfect mirror of that roughness.
        grazing: the same by the reflectance (1 - cos)⁵.
        diffuse: of a white Lambertian surface.
        body: of a white body below a dielectric.
    """

    white: Float[Tensor, "o a 3 p"]
    grazing: Float[Tensor, "o a 3 p"]
    diffuse: Float[Tensor, "o 3 p"]
    body: Float[Tensor, "o 3 p"]

    def __getitem__(self, which: slice) -> Pictures:
        return Pictures(*(getattr(self, each.name)[which] for each in fields(self)))

    @staticmethod
    def joined(parts: Sequence[Pictures]) -> Pictures:
        return Pictures(*(torch.cat([getattr(part, each.name) for part in parts]) for each in fields(Pictures)))


@dataclass(frozen=True)
class CoarseLight:
    """The light of a scene, as coarse as the pictures need it.

    Attributes:
        environment: the scene's own map where it is not large, so that a fit finds its blocks of light made.
        sources: lights beside it.
    """

    environment: Environment
    sources: tuple[Light, ...]

    @staticmethod
    def of(environment: Environment, sources: Sequence[Light]) -> CoarseLight:
        radiance = box_filtered(environment.radiance, COLUMNS)
        return CoarseLight(replace(environment, radiance=radiance), tuple(sources))

    def pictures(self, looks: SampledPixels, orientations: Sequence[Orientation], seed: int = 0) -> Pictures:
        """What the pixels would show in each orientation of the environment."""
        rotation = self.environment.rotation
        matrices = [about_y(rotation) @ each.to_map(rotation) for each in orientations]
        turned = gbuffer.concatenate([_turned(looks.surface, matrix) for matrix in matrices])
        white, grazing = self._mirrored(looks.surface, turned, len(matrices), seed)
        diffuse, body = self._scattered(looks.surface, turned, len(matrices))
        return Pictures(white, grazing, diffuse, body)

    def _mirrored(
        self, surface: GBuffer, turned: GBuffer, count: int, seed: int
    ) -> tuple[Float[Tensor, "o a 3 p"], Float[Tensor, "o a 3 p"]]:
        table = microfacet_table(turned, self.environment, LobeGrid(*ALPHAS, "ggx"), Integration(DEGREE, SAMPLES, seed))
        light = table.mean(torch.float32)
        schlick = fresnel_basis.coefficients(lambda cos: (1 - cos) ** 5, DEGREE, light)[:, 0]
        narrowest, widest, _ = ALPHAS
        alphas = torch.logspace(math.log10(narrowest), math.log10(widest), TRIED).double()
        weights = torch.stack([table.level_weights(alpha) for alpha in alphas]).float()
        found = []
        for values in (light[:, :, 0], torch.einsum("apbc,b->apc", light, schlick)):
            each = torch.einsum("ta,apc->tcp", weights, values).clamp_min(0)
            found.append(each.unflatten(2, (count, -1)).permute(2, 0, 1, 3))
        for source in self.sources:
            direct = DirectLight.of(surface, source)
            for index, curve in enumerate((torch.ones_like, lambda cos: (1 - cos) ** 5)):
                light = torch.stack([direct.reflected(curve, alpha, "ggx").T for alpha in alphas])
                found[index] = found[index] + light.float()
        return found[0], found[1]

    def _scattered(
        self, surface: GBuffer, turned: GBuffer, count: int
    ) -> tuple[Float[Tensor, "o 3 p"], Float[Tensor, "o 3 p"]]:
        normal = middle(turned).normal[:, 0]
        light = cubemap.lookup(self._diffuse_by_normal, normal.float()).unflatten(-1, (DIFFUSE_DEGREE, 3))
        inwards = irradiance_table.coefficients(_passed, light, DIFFUSE_DEGREE)
        diffuse, body = (each.unflatten(0, (count, -1)).mT for each in (light[:, 0], (light * inwards).sum(1)))
        outwards = _passed(surface.n_dot_v).mean(1).float()
        diffuse, body = diffuse.clamp_min(0), (body * outwards).clamp_min(0)
        for source in self.sources:
            direct = DirectLight.of(surface, source)
            diffuse = diffuse + direct.scattered(torch.ones_like, torch.ones_like).T.float()
            body = body + direct.scattered(_passed, _passed).T.float()
        return diffuse, body

    @cached_property
    def _diffuse_by_normal(self) -> Cubemap:
        """The diffuse light of every normal, which all orientations share."""
        normals = cubemap.face_directions(FACE).flatten(0, 2)
        table = irradiance_table.diffuse_table(normals, self.environment, DIFFUSE_DEGREE)
        return Cubemap(table.reshape(6, FACE, FACE, -1))


def _passed(cosine: Tensor) -> Tensor:
    """The share of light that a dielectric lets through, by Schlick's formula."""
    return (1 - PLASTIC) * (1 - (1 - cosine) ** 5)


def _turned(surface: GBuffer, matrix: Float[Tensor, "3 3"]) -> GBuffer:
    """The surface and its viewer in other axes; places are of no use in them."""
    axes = {key: getattr(surface, key) @ matrix.T for key in ("normal", "geometric_normal", "view")}
    return replace(surface, **axes)
