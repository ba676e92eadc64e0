"""Photographs in the viewer's own model: what the thesis's shading makes of a true material."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Shape
from fit_material.renderer.materials.ground_truth import TrueMaterial
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.scene.lights import LightSpec
from fit_material.renderer.viewer_model.model import Appearance
from fit_material.renderer.viewer_model.shading import illuminations, shade_surface
from fit_material.renderer.viewer_model.viewer_light import surroundings
from fit_material.shaders.materials.quantities import ROUGHNESS, Quantity
from fit_material.shaders.materials.types import Material, made_of
from fit_material.shaders.materials.widths import Blur


def viewer_photographer(
    shape: Shape, environment: Environment, materials: Sequence[TrueMaterial], lights: Sequence[LightSpec]
) -> Callable[[Camera, int, Callable[[float], None]], Float[np.ndarray, "h w 4"]]:
    """Who takes photographs as the viewer draws them, one sample in the middle of each pixel; nothing is random.

    Args:
        shape, environment, lights: of the pictures.
        materials: one for each of the shape's names; all but matte ones have a roughness.
    """
    appearances = [Appearance(thesis_material(material)) for material in materials]
    tracer = gbuffer.tracer(shape)
    with torch.no_grad():  # once: what the objects capture of each other is the same for every camera
        lit = illuminations(shape, appearances, surroundings(environment, lights))

    def photograph(camera: Camera, seed: int, progress: Callable[[float], None]) -> Float[np.ndarray, "h w 4"]:
        with torch.no_grad():
            surface = gbuffer.pixel_centres(tracer, camera)
            radiance = shade_surface(surface, appearances, lit)
        progress(1.0)
        return np.concatenate([radiance.numpy(), surface.hit.numpy()[..., None]], -1, dtype=np.float32)

    return photograph


def thesis_material(material: TrueMaterial) -> Material:
    """The thesis's material of these numbers, float64; without a roughness, a mirror."""

    def number(quantity: Quantity) -> Tensor:
        return torch.tensor(getattr(material, quantity.name) or 0.0, dtype=torch.float64)

    return made_of(material.type, number, lambda: Blur(number(ROUGHNESS)))
