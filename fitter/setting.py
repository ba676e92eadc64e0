"""What the radiance of pixels is computed with: the light, the fidelity, and the tables that they call for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from fitter.fidelity import Fidelity
from fitter.pixel_model import DIFFUSE_DEGREE, PixelModel, central, exact_pixels, viewer_pixels
from fitter.reflectances import REFLECTANCES
from renderer import cubemap, transport
from renderer.cubemap import Cubemap
from renderer.environment import Environment
from renderer.gbuffer import GBuffer
from renderer.irradiance import diffuse_table
from renderer.surroundings import Surroundings, surroundings
from renderer.transport import LightTable
from shaders.materials import Material
from shaders.shade import DirectionalLight

DIFFUSE_FACE_SIZE = 24  # texels of 3.75°: a cosine is interpolated to 5e-4


@dataclass(frozen=True)
class Setting:
    """The light on the object, and how accurately to compute it.

    Attributes:
        environment: the surroundings; light is integrated on their device.
        sources: directional lights.
        fidelity: how accurately.
        seed: of the integration.
    """

    environment: Environment
    sources: tuple[DirectionalLight, ...]
    fidelity: Fidelity
    seed: int = 0

    def pixels(self, surface: GBuffer, body: bool) -> PixelModel:
        """The model of pixels [p, k], without a table so far; diffuse light is integrated where there is a body."""
        reflectance = REFLECTANCES[self.fidelity.reflectance]
        if self.fidelity.blurs:
            return viewer_pixels(surface, self.viewers.ambient, self.sources, reflectance)
        diffuse = self._diffuse(surface) if body else None
        return exact_pixels(surface, diffuse, self.sources, self.fidelity.distribution, reflectance)

    def table(
        self,
        surface: GBuffer,
        levels: tuple[float, float, int],
        samples: int,
        progress: Callable[[float], None] = lambda share: None,
    ) -> LightTable:
        """Light through the fidelity's lobe; `levels` are the ends of its roughness and their number."""
        if self.fidelity.lobe == "taps":
            return transport.tap_table(central(surface), self.viewers.cubemap, levels)
        if self.fidelity.lobe == "gaussian":
            return transport.gaussian_table(central(surface), self._near, levels, samples, self.seed)
        return transport.microfacet_table(
            surface,
            self.environment,
            levels,
            distribution=self.fidelity.distribution,
            degree=self.fidelity.degree,
            samples=samples,
            seed=self.seed,
            progress=progress,
        )

    def radiance(self, material: Material, surface: GBuffer, samples: int) -> Float[Tensor, "p 3"]:
        """The picture of one material, float64, by a table that holds its roughness alone."""
        model = self.pixels(surface, body=material.type != "metal")
        if material.type != "matte":
            roughness = float(material.roughness)
            span = (roughness * 0.999, roughness * 1.001, 1)  # the one level lies in their middle
            model = model.under(self.table(surface, span, samples))
        return model.radiance(material)

    @cached_property
    def viewers(self) -> Surroundings:
        """The same light as the viewer has it."""
        return replace(surroundings(self._near), sources=self.sources)

    @property
    def _near(self) -> Environment:
        """The environment on the CPU: 49 taps are not worth the way."""
        return replace(self.environment, radiance=self.environment.radiance.cpu())

    def _diffuse(self, surface: GBuffer) -> Float[Tensor, "p b 3"]:
        normal = torch.nn.functional.normalize(surface.normal.mean(1), dim=-1)
        if len(normal) <= 2 * 6 * DIFFUSE_FACE_SIZE**2:
            return diffuse_table(normal, self._near, DIFFUSE_DEGREE)
        return cubemap.lookup(self._diffuse_by_normal, normal).reshape(len(normal), DIFFUSE_DEGREE, 3)

    @cached_property
    def _diffuse_by_normal(self) -> Cubemap:
        """The table of every normal, for whole pictures: between its texels it is smooth."""
        normals = cubemap.face_directions(DIFFUSE_FACE_SIZE).flatten(0, 2)
        table = diffuse_table(normals, self._near, DIFFUSE_DEGREE)
        return Cubemap(table.reshape(6, DIFFUSE_FACE_SIZE, DIFFUSE_FACE_SIZE, -1))
