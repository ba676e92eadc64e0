"""Models for the comparison of the GL renderer with its torch twin, and the comparison itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int

from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.images.textures import Texture
from fit_material.renderer.materials.textured_material import Appearance, Maps
from fit_material.renderer.viewer_model.model import Model
from fit_material.renderer.viewer_model.viewer_light import Surroundings
from fit_material.shaders.lights import DirectionalLight
from fit_material.shaders.materials.types import Glossy, Material, Matte, Metal
from fit_material.shaders.materials.widths import Blur

TOLERANCE = 1e-4  # relative, at the 99.9th percentile of covered pixels: the figure
FLOOR = 1e-3  # of the picture's mean: what is darker counts as this bright
MOST_ONE_SIDED = 1e-3  # of covered pixels: those on a silhouette, which only one of the two takes for covered

Surface = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def numbers(*values: float) -> Float[torch.Tensor, "..."]:
    return torch.tensor(values if len(values) > 1 else values[0], dtype=torch.float64)


GOLD = numbers(0.18, 0.42, 1.37), numbers(3.42, 2.35, 1.77)
MATERIALS: dict[str, Material] = {
    "metal": Metal(*GOLD, Blur(numbers(0.2))),
    "mirror": Metal(*GOLD, Blur(numbers(0.0))),
    "glossy": Glossy(numbers(0.9, 0.3, 0.1), numbers(0.04, 0.06, 0.1), Blur(numbers(0.3))),
    "matte": Matte(numbers(0.9, 0.3, 0.1), numbers(0.4, 1.0, 0.8)),
}
NEIGHBOUR = Appearance(Glossy(numbers(0.1, 0.3, 0.8), numbers(0.05, 0.05, 0.05), Blur(numbers(0.1))))
LIGHT = DirectionalLight(torch.nn.functional.normalize(numbers(0.3, 0.8, 0.6), dim=0), numbers(3.0, 2.5, 2.0))


def camera(size: int = 512) -> Camera:
    pose = look_at(numbers(1.6, 2.6, 4.2), numbers(0.0, 0.1, 0.0), numbers(0.0, 1.0, 0.0))
    return Camera(pose, size, size, fov=35.0)


def torus(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and normals of a torus round +Y, of radii 1 and 0.45."""
    normal = np.stack([np.cos(v) * np.cos(u), np.sin(v), -np.cos(v) * np.sin(u)], -1)
    return np.stack([np.cos(u), 0 * u, -np.sin(u)], -1) + 0.45 * normal, normal


def ball(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and normals of a small ball above the torus."""
    normal = np.stack([np.sin(v / 2) * np.cos(u), -np.cos(v / 2), -np.sin(v / 2) * np.sin(u)], -1)
    return np.array([0.1, 0.9, 0.2]) + 0.35 * normal, normal


def mesh(*surfaces: Surface, columns: int = 64, rows: int = 32) -> Mesh:
    """Smooth surfaces with texture coordinates, each an object with a material of its own."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    uv = np.tile(np.stack([u, v], -1).reshape(-1, 2), (len(surfaces), 1))
    points = [surface(2 * np.pi * u, 2 * np.pi * v) for surface in surfaces]
    vertices, normals = (np.concatenate([each[i].reshape(-1, 3) for each in points]) for i in (0, 1))
    faces = np.concatenate([_faces(columns, rows) + i * u.size for i in range(len(surfaces))])
    owner = np.repeat(np.arange(len(surfaces)), 2 * columns * rows)
    corner = vertices[faces]
    real = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) > 1e-9
    names = tuple(f"object{i}" for i in range(len(surfaces)))
    part = owner[real] if len(surfaces) > 1 else None
    return Mesh(vertices, faces[real], normals, uv, owner[real], names, part, names)


def _faces(columns: int, rows: int) -> Int[np.ndarray, "f 3"]:
    first = np.arange(columns) + (columns + 1) * np.arange(rows)[:, None]
    corners = first, first + 1, first + columns + 2, first + columns + 1
    halves = ((0, 1, 2), (0, 2, 3))
    return np.concatenate([np.stack([corners[i] for i in half], -1).reshape(-1, 3) for half in halves])


def smooth_texture(height: int, width: int, texel: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Texture:
    """A periodic function of 2πu and 2πv as a texture, which repeats without a seam."""
    v, u = np.meshgrid((np.arange(height)[::-1] + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij")
    return Texture(torch.tensor(texel(2 * np.pi * u, 2 * np.pi * v), dtype=torch.float32))


def _color(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.stack([0.6 + 0.4 * np.sin(3 * u), 0.6 + 0.4 * np.cos(2 * v), 0.7 + 0.3 * np.sin(u + v)], -1)


def _normal(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    normal = np.stack([0.3 * np.cos(5 * u), 0.3 * np.sin(4 * v + u), np.ones_like(u)], -1)
    return (normal / np.linalg.norm(normal, axis=-1, keepdims=True) + 1) / 2


def _openness(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return (0.6 + 0.4 * np.sin(2 * u) * np.cos(3 * v))[..., None].repeat(3, -1)


COLOR_MAP, NORMAL_MAP = smooth_texture(128, 256, _color), smooth_texture(256, 512, _normal)
OCCLUSION_MAP = smooth_texture(96, 128, _openness)


@dataclass(frozen=True)
class Case:
    """What is drawn, and with which effects."""

    material: str
    light: bool = False
    normal_map: bool = False
    occlusion: bool = False
    neighbours: bool = False
    color_map: bool = False

    def model(self) -> Model:
        maps = Maps(
            COLOR_MAP if self.color_map else None,
            NORMAL_MAP if self.normal_map else None,
            OCCLUSION_MAP if self.occlusion else None,
        )
        appearances = (Appearance(MATERIALS[self.material], maps), NEIGHBOUR)
        surfaces: tuple[Surface, ...] = (torus, ball) if self.neighbours else (torus,)
        return Model(mesh(*surfaces), appearances[: len(surfaces)])

    def surroundings(self, far: Surroundings) -> Surroundings:
        return replace(far, sources=(LIGHT,) if self.light else ())

    def __str__(self) -> str:
        effects = [name for name, on in vars(self).items() if on is True]
        return "-".join([self.material, *effects])


def assert_same_picture(
    drawn: Float[np.ndarray, "h w 4"], expected: Float[np.ndarray, "h w 4"], folder: Path, name: str
) -> None:
    """The issue's figure; prints the worst pixel, and leaves both pictures in `folder` where it is missed."""
    both = (drawn[..., 3] == 1) & (expected[..., 3] == 1)
    one_sided = int((drawn[..., 3] != expected[..., 3]).sum())
    error = relative_error(drawn, expected) * both
    worst = tuple(int(i) for i in np.unravel_index(error.argmax(), error.shape))
    percentile = np.quantile(error[both], 0.999)
    told = (
        f"{name}: {percentile:.1e} at the 99.9th percentile of {both.sum()} pixels, {one_sided} covered in one only; "
        f"worst {error[worst]:.1e} at row, column {worst}: {drawn[worst][:3]} for {expected[worst][:3]}"
    )
    print(told)
    if percentile > TOLERANCE or one_sided > MOST_ONE_SIDED * both.sum():
        write_exr(folder / "drawn.exr", drawn)
        write_exr(folder / "expected.exr", expected.astype(np.float32))
        raise AssertionError(f"{told}; pictures in {folder}")


def relative_error(drawn: Float[np.ndarray, "h w 4"], expected: Float[np.ndarray, "h w 4"]) -> Float[np.ndarray, "h w"]:
    """Of the channel that differs most, relative to its value, or to FLOOR of the picture's mean where that is more."""
    floor = FLOOR * expected[expected[..., 3] == 1][:, :3].mean()
    return (np.abs(drawn - expected)[..., :3] / np.maximum(expected[..., :3], floor)).max(-1)
