"""Effects that follow from the model of pixels without them: each a function from model to model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.forward.textured_pixels import TintedPixels
from fit_material.renderer.images.textures import Texture, lookup
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.shaders.registry.registry import Registry


@dataclass(frozen=True)
class SeenPixels:
    """What such an effect may depend on.

    Attributes:
        surface: rays inside each pixel, [p, k].
        body: whether diffuse light is integrated.
        color_map: the tint of the body by texture coordinates; None where it is uniform.
    """

    surface: GBuffer
    body: bool
    color_map: Texture | None


@dataclass(frozen=True)
class PixelEffect:
    """An effect on the pixels' model.

    Attributes:
        name: as `shaders.effects` has it.
        applied: makes the model with it.
    """

    name: str
    applied: Callable[[PixelModel, SeenPixels], PixelModel]


def tinted(model: PixelModel, seen: SeenPixels) -> PixelModel:
    """Bodies in the colours of the map."""
    if seen.color_map is None or not seen.body:
        return model
    return TintedPixels(model, lookup(seen.color_map, seen.surface.uv).double().mean(1))


PIXEL_EFFECTS = Registry(PixelEffect("color-map", tinted))
"""In the order in which they are applied."""
