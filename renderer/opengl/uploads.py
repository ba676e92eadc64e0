"""What a shader reads beside the triangles: textures, cubemaps, the numbers of a material and of the light."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import moderngl
import numpy as np
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.textures import Texture
from fit_material.renderer.opengl.targets import require_fitting
from fit_material.renderer.viewer_model.model import Appearance, Maps
from fit_material.renderer.viewer_model.viewer_light import Surroundings
from fit_material.shaders.lights import DirectionalLight, Light


def cubemap_texture(context: moderngl.Context, faces: Float[Tensor, "6 n n c"]) -> moderngl.TextureCube:
    """A cubemap in float32, looked up bilinearly."""
    size, channels = faces.shape[1], faces.shape[-1]
    texture = context.texture_cube((size, size), channels, faces.float().contiguous().numpy().tobytes(), dtype="f4")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    return texture


def texture_2d(context: moderngl.Context, texture: Texture) -> moderngl.Texture:
    """A texture in float32, looked up bilinearly and repeated; OpenGL's first row is the lowest.

    Raises:
        InputError: it is larger than the graphics card allows.
    """
    height, width, channels = texture.texels.shape
    require_fitting(context, "texture", (width, height))
    texels = texture.texels.flip(0).float().contiguous().numpy().tobytes()
    uploaded = context.texture((width, height), channels, texels, dtype="f4")
    uploaded.filter = (moderngl.LINEAR, moderngl.LINEAR)
    if channels == 1:
        uploaded.swizzle = "RRR1"  # grey is three equal channels
    return uploaded


def map_textures(context: moderngl.Context, maps: Maps) -> dict[str, moderngl.Texture]:
    """A material's maps by the shader's name for them."""
    named = {"color_map": maps.color, "normal_map": maps.normal, "ambient_occlusion_map": maps.ambient_occlusion}
    return {name: texture_2d(context, texture) for name, texture in named.items() if texture is not None}


def material_uniforms(appearance: Appearance) -> dict[str, Any]:
    """A material's numbers under their own names."""
    return {name: number.detach().numpy() for name, number in appearance.material.numbers.items()}


def light_uniforms(surroundings: Surroundings) -> dict[str, Any]:
    """Ambient light and directional lights.

    Raises:
        InputError: as `_drawable`.
    """
    sources = [_drawable(source) for source in surroundings.sources]
    return {
        "ambient_coefficients": surroundings.ambient.numpy(),
        "light_towards": np.array([source.towards.numpy() for source in sources]),
        "light_radiance": np.array([source.radiance.numpy() for source in sources]),
    }


def _drawable(light: Light) -> DirectionalLight:
    """A light as shaders/glsl/shade.glsl has it.

    Raises:
        InputError: the light is of another type.
    """
    if isinstance(light, DirectionalLight):
        return light
    raise InputError("[[lights]]", "type", f'"{light.kind}"', '"directional": the viewer draws no other lights')


def turn_uniforms(rotation: float) -> Mapping[str, Any]:
    """From world axes to those of an environment that is rotated by `rotation` degrees about +Y."""
    sin, cos = math.sin(math.radians(rotation)), math.cos(math.radians(rotation))
    into_environment = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    return {"into_environment": into_environment.T}
