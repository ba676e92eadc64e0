"""Small scenes whose light is soft: what is integrated is then exact beside the noise of the photographs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueMaterial, TrueMetal
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

Vector = tuple[float, float, float]
LAMPS: tuple[tuple[Vector, float, Vector], ...] = (  # towards, sharpness, radiance
    ((1.0, 1.0, 1.0), 8.0, (6.0, 5.0, 4.0)),
    ((-2.0, 0.5, -1.0), 5.0, (1.0, 2.0, 3.0)),
    ((0.0, -1.0, 0.3), 3.0, (0.5, 0.6, 0.3)),
)


def gold(alpha: float = 0.2) -> TrueMetal:
    known = metal("Au")
    return TrueMetal(known.n, known.k, alpha)


def soft_light(height: int = 32) -> Float[np.ndarray, "h w 3"]:
    """A grey sky with a few wide lamps, as a latitude–longitude map."""
    polar = (np.arange(height) + 0.5) / height * np.pi
    azimuth = (np.arange(2 * height) + 0.5) / height * np.pi
    level = np.sin(polar)[:, None]
    towards = np.stack([level * np.sin(azimuth), np.cos(polar)[:, None] + 0 * azimuth, -level * np.cos(azimuth)], -1)
    light = np.full(towards.shape, 0.3)
    for direction, sharpness, radiance in LAMPS:
        middle = np.array(direction) / np.linalg.norm(direction)
        light += np.exp(sharpness * (towards @ middle - 1))[..., None] * np.array(radiance)
    return light.astype(np.float32)


def soft_scene(folder: Path, material: TrueMaterial, *, views: int = 2, size: int = 40, spp: int = 32) -> Path:
    """Photographs of a ball, path-traced with the noise of few samples; the path of scene.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    write_exr(folder / "soft.exr", soft_light())
    options = SynthOptions(material, views=views, size=size, spp=spp, env=str(folder / "soft.exr"))
    return synthesise(options, folder)
