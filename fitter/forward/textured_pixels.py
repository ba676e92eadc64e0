"""Pixels of a body whose colour varies over its surface: by a known texture, or by colours that are free in places."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.shaders.materials.types import Material

LEAST_COLOR = 1e-3  # mean colour of places, below which a tint would only be noise


class TexturedPixels(PixelModel):
    """Pixels whose colour is the material's times a tint of their own; the model has to be linear in the colour.

    Attributes:
        model: of the same pixels in one colour.
    """

    model: PixelModel

    @property
    def table(self) -> LightTable | None:  # type: ignore[override]
        return self.model.table

    def under(self, table: LightTable | None) -> TexturedPixels:
        return replace(self, model=self.model.under(table))  # type: ignore[type-var] — the subclasses are dataclasses

    def radiance(self, material: Material) -> Float[Tensor, "p 3"]:
        """Radiance of every pixel; a metal has no body to be tinted."""
        if material.color is None:
            return self.model.radiance(material)
        surface, body = surface_and_body(self.model, material)
        return surface + material.color * self.tint_by(surface, body) * body

    def tint(self, material: Material) -> Float[Tensor, "p 3"]:
        """The tint of every pixel under a material that has a body."""
        return self.tint_by(*surface_and_body(self.model, material))

    @abstractmethod
    def tint_by(self, surface: Float[Tensor, "p 3"], body: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
        """The tint, where the surface mirrors that much light and a white body sends out that much."""


@dataclass(frozen=True)
class TintedPixels(TexturedPixels):
    """Pixels under a known texture.

    Attributes:
        model: of the same pixels in one colour.
        known: mean of the texture over each pixel.
    """

    model: PixelModel
    known: Float[Tensor, "p 3"]

    def tint_by(self, surface: Float[Tensor, "p 3"], body: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
        return self.known


@dataclass(frozen=True)
class MultiViewPixels(TexturedPixels):
    """Pixels that see a few points of the surface, each from several sides; each point's colour is free.

        c_s = Σ w² body (seen - surface) / Σ w² body²        over the pixels of point s, per channel

    A point's colour is always the one by which it comes nearest to the photographs: it is eliminated [Golub & Pereyra
    1973], and what a fit goes by is how points change with the direction from which they are seen. The tint is c_s over
    its mean, so that the material's colour is the points' mean.

    Attributes:
        model: of the same pixels in one colour.
        point: the number of each pixel's.
        seen: what the photographs show.
        weight: of each difference.
    """

    model: PixelModel
    point: Int[Tensor, " p"]
    seen: Float[Tensor, "p 3"]
    weight: Float[Tensor, "p 3"]

    def tint_by(self, surface: Float[Tensor, "p 3"], body: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
        _, index = self.point.unique(return_inverse=True)
        none = torch.zeros(int(index.max()) + 1, 3, dtype=body.dtype)
        weighted = self.weight**2 * body
        total = none.index_add(0, index, weighted * body).clamp_min(torch.finfo(body.dtype).tiny)
        color = none.index_add(0, index, weighted * (self.seen - surface)) / total
        return (color / color.mean(0).clamp_min(LEAST_COLOR))[index]


def surface_and_body(model: PixelModel, material: Material) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 3"]]:
    """What the surface mirrors, and what a white body below it would send out."""
    assert material.color is not None
    white = model.radiance(material.with_color(torch.ones_like(material.color)))
    if not material.mirrors:
        return torch.zeros_like(white), white
    surface = model.radiance(material.with_color(torch.zeros_like(material.color)))
    return surface, white - surface
