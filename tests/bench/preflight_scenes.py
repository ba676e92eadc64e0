"""Twenty scenes of random materials, shapes and lights, on which the preflight is measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fit_material.renderer.environment.environment import directions
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueGlossy, TrueMaterial, TrueMatte, TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions
from tests.bench.photographs import photographed
from tests.bench.setting import CACHE
from tests.support.paths import SHARED

COUNT = 20
METALS = ("Au", "Cu", "Al", "Fe", "Cr", "Ti")
MAPS = sorted((SHARED / "env").glob("*.hdr")) + sorted((SHARED / "env_exr_dwab").glob("*.exr"))
SPP, NOISE = 256, 0.01


@dataclass(frozen=True)
class PreflightScene:
    """One scene, all of it chosen by its number."""

    index: int

    @cached_property
    def folder(self) -> Path:
        """The folder of its photographs, of `scene.toml` and all that this names."""
        random = np.random.default_rng([11, self.index])
        options = SynthOptions(
            self._material(random),
            mesh=self._mesh(random),
            env=str(self._environment()),
            views=int(random.integers(2, 4)),
            size=int(random.choice((64, 80, 96))),
            spp=SPP,
            noise=NOISE,
            seed=self.index,
        )
        return photographed(options, f"preflight-{self.index}").parent

    def _material(self, random: np.random.Generator) -> TrueMaterial:
        """Metals, glossy and matte materials in turn."""
        alpha, color = float(np.exp(random.uniform(np.log(0.04), np.log(0.5)))), random.uniform(0.1, 0.8, 3)
        if self.index % 3 == 0:
            known = metal(METALS[self.index // 3 % len(METALS)])
            return TrueMetal(known.n, known.k, alpha, metal=known.name)
        told = tuple(float(value) for value in color)
        return TrueMatte(told) if self.index % 3 == 2 else TrueGlossy(told, (0.04,) * 3, min(alpha, 0.3))

    def _mesh(self, random: np.random.Generator) -> Path | None:
        """A sphere, an ellipsoid, a blob, a torus in turn; None for the sphere."""
        kind = ("sphere", "ellipsoid", "blob", "torus")[self.index % 4]
        path = CACHE / f"preflight-{kind}-{self.index}.obj"
        if kind != "sphere" and not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(_obj(kind, random), encoding="utf-8")
        return None if kind == "sphere" else path

    def _environment(self) -> Path:
        """Measured maps where there are any, in turn with studios that were made up."""
        if self.index % 2 == 0 and MAPS:
            return MAPS[self.index // 2 % len(MAPS)]
        path = CACHE / f"preflight-studio-{self.index}.exr"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_exr(path, studio_of(self.index))
        return path


def studio_of(seed: int, height: int = 128) -> Float[np.ndarray, "h w 3"]:
    """A dim room with some soft lamps, of places, sizes and colours by chance."""
    random = np.random.default_rng([7, seed])
    towards = directions(height, 2 * height).numpy()
    light = 0.1 + 0.15 * (1 + towards[..., 1:2]) * random.uniform(0.5, 1, 3)
    for _ in range(random.integers(4, 9)):
        centre = random.normal(size=3)
        width = random.uniform(0.08, 0.35)
        glow = np.exp((towards @ (centre / np.linalg.norm(centre)) - 1) / width**2)
        light = light + glow[..., None] * random.uniform(0.5, 1, 3) * 0.6 / width**1.5
    return light.astype(np.float32)


def _obj(kind: str, random: np.random.Generator) -> str:
    """A smooth solid that no turn but by 180° brings back, as OBJ with normals."""
    import trimesh

    if kind == "torus":
        mesh = trimesh.creation.torus(1.0, 0.42, major_sections=64, minor_sections=32)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(random.uniform(-0.5, 0.5), [0, 0, 1]))
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2 + random.uniform(-0.4, 0.4), [1, 0, 0]))
    else:
        mesh = trimesh.creation.icosphere(4)
        if kind == "blob":
            mesh.vertices *= (1 + 0.12 * np.sin(mesh.vertices @ random.normal(0, 1.6, (3, 3))).sum(1))[:, None]
        mesh.apply_scale(random.permutation((1.0, 0.75, 0.55)))
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in mesh.vertices]
    lines += [f"vn {x:.7g} {y:.7g} {z:.7g}" for x, y, z in mesh.vertex_normals]
    lines += ["f " + " ".join(f"{i}//{i}" for i in face + 1) for face in mesh.faces]
    return "\n".join(lines) + "\n"
