"""Normal maps and maps of ambient occlusion that a scene file names, read and checked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.mesh import Mesh, Shape, faceted
from fit_material.renderer.geometry.tangents import with_mirrored_apart
from fit_material.renderer.images.textures import Texture, read_texture
from fit_material.renderer.materials.textured_material import Maps
from fit_material.renderer.scene.scene_file import MaterialSpec


def given_maps(specs: Sequence[MaterialSpec], shape: Shape, names: Sequence[str], scene_file: Path) -> tuple[Maps, ...]:
    """The maps of each of the shape's materials, in their order.

    Raises:
        InputError: there is nothing to lay them over, or a file is no such map.
    """
    found = {name: Maps() for name in names}
    for index, spec in enumerate(specs):
        for key in ("normal_map", "ambient_occlusion_map"):
            file = getattr(spec, key)
            if file is not None and (not isinstance(shape, Mesh) or shape.uv is None):
                field = f"materials[{index}].{key}"
                raise InputError(scene_file, field, file.name, "a mesh with texture coordinates (vt) to lay it over")
        found[spec.name] = Maps(
            normal=_normal(spec.normal_map), ambient_occlusion=_openness(spec.ambient_occlusion_map)
        )
    return tuple(found[name] for name in names)


def _normal(file: Path | None) -> Texture | None:
    if file is None:
        return None
    texture = read_texture(file, color=False)
    if torch.equal(texture.texels, texture.texels[..., :1].expand_as(texture.texels)):
        raise InputError(file, expected="a normal map in colours, not a grey height map")
    inwards = float((texture.texels[..., 2] <= 0.5).float().mean())
    if inwards > 0.5:
        expected = "a normal map whose texels point outwards, their blue above 0.5"
        raise InputError(file, "blue", f"0.5 or less in {inwards:.0%} of the texels", expected)
    return texture


def _openness(file: Path | None) -> Texture | None:
    if file is None:
        return None
    texture = Texture(read_texture(file, color=False).texels[..., :1])
    if not texture.texels.any():
        raise InputError(file, expected="a map of ambient occlusion that is not black all over")
    return texture


def shape_under(shape: Shape, maps: Sequence[Maps]) -> Shape:
    """The shape with what normal maps take: vertex normals, and no vertex that two mirrored halves of a map share."""
    if not isinstance(shape, Mesh) or all(each.normal is None for each in maps):
        return shape
    return with_mirrored_apart(faceted(shape) if shape.normals is None else shape)
