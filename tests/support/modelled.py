"""Scenes on disk whose photographs our own model makes, in a second and without path tracing."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import trimesh
from jaxtyping import Float

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Mesh, Shape, Sphere, read_mesh
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.picture import draw
from fit_material.shaders.materials.types import Material

DISTANCE, FOV = 4.0, 30.0  # of the cameras from the ball's middle, and their angle of view in degrees
SAMPLES = 512  # directions per pixel of a photograph


@dataclass(frozen=True)
class Modelled:
    """A ball, what it is made of, and what lights it.

    Attributes:
        materials: by name, from the bottom upwards, each a slice of the ball; of one, it is the exact sphere.
        light: radiance of the map.
        azimuths: degrees about +Y at which the cameras stand, 0 at +Z.
        rotation: degrees about +Y by which light and cameras are turned together.
        brightness: factor on light and photographs.
        size: pixels along a photograph's side.
        noise: standard deviation of the photographs' relative noise.
        seed: of that noise.
    """

    materials: dict[str, Material]
    light: Float[np.ndarray, "h w 3"]
    azimuths: tuple[float, ...] = (0.0,)
    rotation: float = 0.0
    brightness: float = 1.0
    size: int = 16
    noise: float = 0.0
    seed: int = 0


def written(scene: Modelled, folder: Path) -> Path:
    """The scene's files; the path of scene.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    write_exr(folder / "map.exr", scene.light * np.float32(scene.brightness))
    lines, shape = _geometry(scene, folder)
    lines += ["[environment]", 'map = "map.exr"', f"rotation = {scene.rotation}"]
    for azimuth in scene.azimuths:
        picture, origin = _photograph(scene, shape, azimuth)
        write_exr(folder / f"view_{azimuth:g}.exr", picture)
        lines += ["[[photographs]]", f'image = "view_{azimuth:g}.exr"', "[photographs.camera]"]
        lines += [f"origin = {json.dumps(origin)}", "target = [0, 0, 0]", f"fov = {FOV}"]
    (folder / "scene.toml").write_text("\n".join(lines) + "\n")
    return folder / "scene.toml"


def _geometry(scene: Modelled, folder: Path) -> tuple[list[str], Shape]:
    if len(scene.materials) == 1:
        return ["[geometry]", 'shape = "sphere"'], Sphere()
    (folder / "ball.obj").write_text(_sliced_ball(list(scene.materials)))
    return ["[geometry]", 'mesh = "ball.obj"'], read_mesh(folder / "ball.obj")


def _sliced_ball(names: list[str]) -> str:
    """A ball of 320 triangles with the true one's normals, cut into slices of different materials."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    slices = np.clip((ball.triangles_center[:, 1] + 1) / 2 * len(names), 0, len(names) - 1).astype(int)
    lines = [f"{key} {x:.17g} {y:.17g} {z:.17g}" for key in ("v", "vn") for x, y, z in ball.vertices]
    for index, name in enumerate(names):
        lines += [f"usemtl {name}", *(f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in ball.faces[slices == index] + 1)]
    return "\n".join(lines) + "\n"


def _photograph(scene: Modelled, shape: Shape, azimuth: float) -> tuple[Float[np.ndarray, "h w 4"], list[float]]:
    """Radiance with coverage, and where its camera stands."""
    angle = np.deg2rad(azimuth + scene.rotation)
    origin = [DISTANCE * float(np.sin(angle)), 0.5, DISTANCE * float(np.cos(angle))]
    pose = look_at(torch.tensor(origin), torch.zeros(3), torch.tensor([0.0, 1.0, 0.0]))
    light = torch.from_numpy(scene.light) * scene.brightness
    lighting = Lighting(Environment(light, scene.rotation), (), PRESETS["preview"], seed=7)

    def shade(surface: GBuffer) -> Float[torch.Tensor, "p 3"]:
        names = shape.material_names if isinstance(shape, Mesh) else scene.materials
        shown = [lighting.radiance(scene.materials[name], surface, SAMPLES) for name in names]
        return torch.stack(shown, 1)[torch.arange(len(surface.hit)), surface.material[:, 0]]

    everywhere = torch.ones(scene.size, scene.size, dtype=torch.bool)
    picture = draw(gbuffer.tracer(shape), Camera(pose, scene.size, scene.size, fov=FOV), everywhere, 1, 2, shade)
    generator = np.random.default_rng([scene.seed, round(azimuth)])
    noisy = picture.radiance.numpy() * (1 + scene.noise * generator.standard_normal(picture.radiance.shape))
    return np.concatenate([noisy, picture.mask.numpy()[..., None]], -1).astype(np.float32), origin
