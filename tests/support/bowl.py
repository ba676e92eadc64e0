"""A bowl that mirrors itself: the lower part of a sphere seen from above, its inner side the front."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np

from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.synthesis.camera_placement import View
from fit_material.renderer.synthesis.scene_writer import scene_toml
from fit_material.renderer.synthesis.studio import studio

N, K, ALPHA = (0.146, 0.425, 1.431), (3.578, 2.326, 1.85), 0.3
RIM = np.deg2rad(115)  # from the zenith
ROWS, COLUMNS = 16, 32


@cache
def bowl() -> Mesh:
    """Radius 1, open towards +Y, its normals the true sphere's, inwards."""
    polar = np.linspace(RIM, np.pi, ROWS + 1)[:, None]
    azimuth = np.linspace(0, 2 * np.pi, COLUMNS, endpoint=False)[None]
    place = np.sin(polar) * np.sin(azimuth), np.cos(polar) + 0 * azimuth, np.sin(polar) * np.cos(azimuth)
    vertices = np.stack(place, -1).reshape(-1, 3)
    row, column = (grid.ravel() for grid in np.mgrid[:ROWS, :COLUMNS])
    here, there = (row * COLUMNS + each % COLUMNS for each in (column, column + 1))
    faces = np.concatenate(
        [np.stack([here, there, there + COLUMNS], 1), np.stack([here, there + COLUMNS, here + COLUMNS], 1)]
    )
    corner = vertices[faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    whole = np.linalg.norm(across, axis=1) > 1e-9  # those at the pole have no area
    outwards = (across * corner.mean(1)).sum(1) > 0
    faces[outwards] = faces[outwards][:, ::-1]
    faces = faces[whole]
    return Mesh(vertices, faces, -vertices, np.zeros((len(vertices), 2)), np.zeros(len(faces), dtype=int))


@cache
def light() -> Environment:
    """A small studio."""
    return studio(64)


def looks(count: int = 3) -> list[View]:
    """Cameras above it, that see the inside alone."""
    tilts = [math.radians(15 + 10 * i) for i in range(count)]
    turns = [2 * math.pi * i / count for i in range(count)]
    origins = [
        (5 * math.sin(tilt) * math.sin(turn), 5 * math.cos(tilt), 5 * math.sin(tilt) * math.cos(turn))
        for tilt, turn in zip(tilts, turns, strict=True)
    ]
    return [View(origin, (0.0, -0.3, 0.0), (0.0, 0.0, 1.0), 25.0) for origin in origins]


def photographs(folder: Path, size: int, spp: int) -> Path:
    """A scene file with Mitsuba's photographs of the bowl in gold; paths of eight segments."""
    mesh = bowl()
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*vertex) for vertex in mesh.vertices]
    lines += ["vn {:.9g} {:.9g} {:.9g}".format(*-vertex) for vertex in mesh.vertices]
    lines += ["f " + " ".join(f"{corner}//{corner}" for corner in face) for face in mesh.faces + 1]
    (folder / "bowl.obj").write_text("\n".join(lines))
    write_exr(folder / "environment.exr", light().radiance.numpy())
    for i, look in enumerate(looks()):
        picture = render(
            mesh, look.camera(size), light(), conductor(N, K, ALPHA), spp=spp, seed=i, variant="llvm_ad_rgb"
        )
        write_exr(folder / f"view_{i}.exr", picture)
    (folder / "scene.toml").write_text(scene_toml(folder / "bowl.obj", (), looks()), encoding="utf-8")
    return folder / "scene.toml"
