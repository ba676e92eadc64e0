"""Photographs by Mitsuba of a mesh under a texture that is known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from fit_material.renderer.geometry.mesh import read_mesh
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.images.textures import Texture, lookup
from fit_material.renderer.mitsuba.conversion import mitsuba, variant_here
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.renderer.synthesis.scene_writer import scene_toml
from fit_material.renderer.synthesis.synthesise import named_environment


def photograph_textured(
    folder: Path,
    mesh: Path,
    texture: Float[np.ndarray, "h w 3"],
    bsdf: Mapping[str, Any],
    *,
    env: str = "studio",
    count: int = 4,
    size: int = 64,
    spp: int = 256,
    max_depth: int = 2,
    normals: Float[np.ndarray, "h w 3"] | None = None,
) -> Path:
    """Write photographs, environment, mesh and scene file.

    Args:
        folder: where to.
        mesh: an .obj with texture coordinates.
        texture: linear, first row at v = 1.
        bsdf: a Mitsuba material; the texture takes the place of its `reflectance` or `diffuse_reflectance`.
        env, count, size, spp, max_depth: as of `synthesise.SynthOptions`; of depth 2 light is reflected once.
        normals: a normal map, in [0, 1], or none.

    Returns:
        The scene file.
    """
    variant = variant_here()
    mi = mitsuba(variant)
    bitmap = mi.Bitmap(np.ascontiguousarray(texture[::-1], np.float32))  # Mitsuba's first row is at v = 0
    key = "reflectance" if bsdf["type"] == "diffuse" else "diffuse_reflectance"
    material = {**bsdf, key: {"type": "bitmap", "bitmap": bitmap, "raw": True}}
    if normals is not None:
        relief = mi.Bitmap(np.ascontiguousarray(normals[::-1], np.float32))
        relief = {"type": "bitmap", "bitmap": relief, "raw": True}
        material = {"type": "normalmap", "normalmap": relief, "bsdf": material}
    shape, environment = read_mesh(mesh), named_environment(env)
    poses = views(count, shape)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / mesh.name).write_bytes(mesh.read_bytes())
    write_exr(folder / "environment.exr", environment.radiance.numpy())
    for index, pose in enumerate(poses):
        camera = pose.camera(size)
        picture = render(
            shape, camera, environment, material, spp=spp, seed=index, max_depth=max_depth, variant=variant
        )
        write_exr(folder / f"view_{index}.exr", picture)
    scene = folder / "scene.toml"
    scene.write_text(scene_toml(folder / mesh.name, (), poses), encoding="utf-8")
    return scene


def ball(path: Path, rows: int = 24, columns: int = 48) -> Path:
    """A unit ball with texture coordinates and vertex normals: u round +Y, v from the south pole to the north pole."""
    u, v = _grid(rows, columns)
    theta, phi = np.pi * (1 - v), 2 * np.pi * u
    normal = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1)
    return _write(path, normal, normal)


def ring(path: Path, thickness: float = 0.5, rows: int = 24, columns: int = 48) -> Path:
    """A torus of radius 1 about +Y with texture coordinates and vertex normals, whose inner side lights itself."""
    u, v = _grid(rows, columns)
    theta, phi = 2 * np.pi * v, 2 * np.pi * u
    normal = np.stack([np.cos(theta) * np.sin(phi), np.sin(theta), np.cos(theta) * np.cos(phi)], -1)
    axis = np.stack([np.sin(phi), 0 * phi, np.cos(phi)], -1)
    return _write(path, axis + thickness * normal, normal)


def _grid(rows: int, columns: int) -> tuple[Float[np.ndarray, "r c"], Float[np.ndarray, "r c"]]:
    """u and v of vertices from (0, 0) to (1, 1)."""
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    return u, v


def _write(path: Path, places: Float[np.ndarray, "r c 3"], normals: Float[np.ndarray, "r c 3"]) -> Path:
    rows, columns = (count - 1 for count in places.shape[:2])
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in places.reshape(-1, 3)]
    lines += [f"vn {x:.9f} {y:.9f} {z:.9f}" for x, y, z in normals.reshape(-1, 3)]
    lines += [f"vt {a:.9f} {b:.9f}" for a, b in zip(*(each.ravel() for each in _grid(rows, columns)), strict=True)]
    number = 1 + np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    for i in range(rows):
        for j in range(columns):
            a, b, c, d = number[i, j], number[i, j + 1], number[i + 1, j + 1], number[i + 1, j]
            lines.append(" ".join(["f", *(f"{n}/{n}/{n}" for n in (a, b, c, d))]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def pattern(size: int) -> Float[np.ndarray, "h w 3"]:
    """A texture that changes smoothly, with squares of another colour in it; linear, in [0.05, 0.85]."""
    y, x = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size, indexing="ij")
    smooth = np.stack([0.45 + 0.3 * np.sin(2 * np.pi * x), 0.4 + 0.25 * np.cos(np.pi * y), 0.3 + 0 * x], -1)
    squares = ((np.floor(8 * x) + np.floor(4 * y)) % 4 == 0)[..., None]
    return np.where(squares, [0.1, 0.2, 0.7], smooth)


def seen_at(texture: Float[np.ndarray, "h w 3"], size: int, within: int = 8) -> Float[np.ndarray, "s s 3"]:
    """The mean of a texture over each of size² texels, from within² lookups."""
    place = (np.arange(size * within) + 0.5) / (size * within)
    v, u = np.meshgrid(1 - place, place, indexing="ij")
    found = lookup(Texture(torch.from_numpy(texture)), torch.from_numpy(np.stack([u, v], -1)))
    return found.numpy().reshape(size, within, size, within, 3).mean((1, 3))
