"""Shapes whose pictures are known in closed form, and folders of small photographs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import torch

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.ground_truth import TrueGlossy, TrueMatte, TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

SIZE = 24
GOLD = TrueMetal((0.146, 0.425, 1.431), (3.578, 2.326, 1.85), 0.2)
RED = TrueGlossy((0.6, 0.1, 0.05), (0.04, 0.04, 0.04), 0.15)
CLAY = TrueMatte((0.5, 0.3, 0.2))
COLORS = ((0.8, 0.2, 0.1), (0.1, 0.7, 0.3), (0.2, 0.1, 0.9))
NAMES = ("warm", "green, with a comma", "cold")
OCTAHEDRON = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


KEYS = "name type n k alpha roughness color reflectance f0 distribution metal source held"


def grey_map(folder: Path) -> str:
    """A file of radiance 1 from everywhere."""
    path = folder / "grey.exr"
    write_exr(path, np.ones((8, 16, 3), np.float32))
    return str(path)


def octahedron(folder: Path) -> Path:
    """A file of |x| + |y| + |z| = 1, whose i-th octant is made of NAMES[i % 3]; convex: no side sees another."""
    lines = ["v 1 0 0", "v -1 0 0", "v 0 1 0", "v 0 -1 0", "v 0 0 1", "v 0 0 -1"]
    for i, (x, y, z) in enumerate(OCTAHEDRON):
        corners = [1 + (x < 0), 3 + (y < 0), 5 + (z < 0)]
        corners = corners if x * y * z > 0 else corners[::-1]
        lines += [f"usemtl {NAMES[i % 3]}", f"f {corners[0]} {corners[1]} {corners[2]}"]
    path = folder / "octahedron.obj"
    path.write_text("\n".join(lines))
    return path


def materials_seen(camera: Camera) -> np.ndarray:
    """Index into NAMES of the side that fills each pixel; -1 where it is not one side alone."""
    row, column = torch.meshgrid(torch.arange(SIZE + 1.0), torch.arange(SIZE + 1.0), indexing="ij")
    corner = sides_seen(*(v.numpy() for v in camera.rays(column, row)))
    four = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]])
    return np.where((four == four[0]).all(0) & (four[0] >= 0), four[0] % 3, -1)


def sides_seen(origin: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Octant of the octahedron that rays enter by, which is the last half-space that they enter; -1 if they pass."""
    towards, before = along @ OCTAHEDRON.T, 1 - origin @ OCTAHEDRON.T
    times = before / towards
    enters = np.where(towards < 0, times, -np.inf)
    leaves = np.where(towards > 0, times, np.inf)
    return np.where(enters.max(-1) < leaves.min(-1), enters.argmax(-1), -1)


def ball_seen(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the unit sphere at pixel centres: normal, n·v, and the mirrored view direction; nan beside it."""
    row, column = torch.meshgrid(torch.arange(SIZE) + 0.5, torch.arange(SIZE) + 0.5, indexing="ij")
    origin, along = (v.numpy() for v in camera.rays(column, row))
    half = (origin * along).sum(-1)
    with np.errstate(invalid="ignore"):
        distance = -half - np.sqrt(half**2 - (origin**2).sum(-1) + 1)
    normal = origin + distance[..., None] * along
    n_dot_v = -(normal * along).sum(-1)
    return normal, n_dot_v, along + 2 * n_dot_v[..., None] * normal


def truth_of(folder: Path, options: SynthOptions) -> dict:
    synthesise(options, folder)
    return json.loads((folder / "truth.json").read_text(encoding="utf-8"))
