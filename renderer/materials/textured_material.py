"""How a material looks on a surface: its numbers, and the maps that vary them."""

from __future__ import annotations

from dataclasses import dataclass

from fit_material.renderer.images.textures import Texture
from fit_material.shaders.materials.types import Material


@dataclass(frozen=True)
class Maps:
    """Textures of a material, None where there is none.

    Attributes:
        color: linear Rec. 709, multiplies the material's colour; a metal has none.
        normal: tangent-space normals, n = 2·rgb - 1, +Z out of the surface, +Y towards growing v.
        ambient_occlusion: one channel, 1 where open, 0 where closed.
    """

    color: Texture | None = None
    normal: Texture | None = None
    ambient_occlusion: Texture | None = None


@dataclass(frozen=True)
class Appearance:
    """A material with its maps."""

    material: Material
    maps: Maps = Maps()
