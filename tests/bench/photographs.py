"""Synthetic photographs for the benchmarks, rendered once and kept outside the tree."""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from fit_material.renderer.files.atomic import replaced_together, write_text_atomically
from fit_material.renderer.images.image_file import read_image, write_exr
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.materials.ground_truth import TrueMetal
from fit_material.renderer.synthesis.scene_writer import outputs_of
from fit_material.renderer.synthesis.synthesise import SynthOptions, noisy, synthesise
from tests.bench.setting import CACHE
from tests.support.paths import SHARED

METALS = ("Au", "Cu", "Al", "Fe")
ALPHAS = (0.05, 0.2, 0.5)
ENVIRONMENTS = ("studio_small_03", "rooitou_park", "st_peters_square_night")
MEASURED = ".npz"  # what benchmarks have measured of photographs, kept beside them
SHAPES = {
    "sphere": None,
    "icosphere": SHARED / "meshes" / "icosphere5.obj",
    "spot": SHARED / "meshes" / "spot" / "spot_triangulated.obj",
}


def map_of(environment: str) -> str:
    """The path of one of the shared maps."""
    return str(SHARED / "env" / f"{environment}_1k.hdr")


def photographed(options: SynthOptions, label: str) -> Path:
    """The scene file of Mitsuba's photographs; renders them where they are not kept from an earlier run.

    Noise is put on photographs without, so that both are of the same paths and these are traced once.
    """
    scene = _folder(options, label) / "scene.toml"
    if scene.exists():
        return scene
    if not options.noise:
        return synthesise(options, scene.parent)
    return _with_noise(photographed(replace(options, noise=0.0), label), options, scene)


def _folder(options: SynthOptions, label: str) -> Path:
    key = hashlib.sha256(repr(sorted(asdict(options).items(), key=str)).encode()).hexdigest()[:16]
    return CACHE / f"{label}-{key}"


def _with_noise(clean: Path, options: SynthOptions, scene: Path) -> Path:
    """A copy of a scene with noise on its photographs: what `synthesise` writes for these options."""
    with replaced_together(scene.parent, last="scene.toml") as folder:
        for path in clean.parent.iterdir():
            if path.suffix != MEASURED and path.name != "truth.json":
                os.link(path, folder / path.name)
        for index in range(options.views):
            image = read_image(clean.with_name(f"view_{index}.exr"))
            pixels = np.concatenate([image.radiance, image.alpha[..., None]], -1)  # type: ignore[index] — synth's have it
            write_exr(folder / f"view_{index}.exr", noisy(pixels, options, index))
        truth = json.loads(clean.with_name("truth.json").read_text(encoding="utf-8"))
        truth |= {"noise": options.noise, **outputs_of(folder, scene.parent)}
        write_text_atomically(folder / "truth.json", json.dumps(truth, indent=2, ensure_ascii=False) + "\n")
    return scene


def truth_of(scene: Path) -> dict:
    """The material of photographs that were made here."""
    return json.loads(scene.with_name("truth.json").read_text(encoding="utf-8"))["materials"][0]


@dataclass(frozen=True)
class Case:
    """One metal object in one light.

    Attributes:
        metal: a symbol of the catalogue.
        alpha: microfacet width.
        environment, shape: of `ENVIRONMENTS`, `SHAPES`.
        size: of the photographs, in pixels.
        spp: samples a pixel.
        views: number of photographs.
        noise: standard deviation of a factor on every value.
        seed: of paths and noise.
    """

    metal: str
    alpha: float
    environment: str = "studio_small_03"
    shape: str = "sphere"
    size: int = 128
    spp: int = 512
    views: int = 3
    noise: float = 0.0
    seed: int = 0

    @property
    def with_noise_of_its_own(self) -> Case:
        """The same with a seed that follows from it: of one seed, errors in a light would be alike for all metals."""
        return replace(self, seed=zlib.crc32(self.label.encode()))

    @property
    def label(self) -> str:
        """What it is of, for people."""
        return f"{self.shape}-{self.metal}-{self.alpha:g}-{self.environment}"

    def scene(self, variant: str) -> Path:
        """The scene file; renders the photographs where they are not kept from an earlier run."""
        return photographed(self.options(variant), self.label)

    def measured(self, what: str, variant: str) -> Path:
        """The file of what was measured of all such photographs, whatever their seed."""
        return _folder(replace(self, seed=0).options(variant), self.label) / f"{what}{MEASURED}"

    def options(self, variant: str) -> SynthOptions:
        """What `synth` is asked for."""
        known = metal(self.metal)
        return SynthOptions(
            TrueMetal(known.n, known.k, self.alpha, metal=known.name, source=known.source),
            mesh=SHAPES[self.shape],
            env=map_of(self.environment),
            views=self.views,
            size=self.size,
            spp=self.spp,
            noise=self.noise,
            seed=self.seed,
            variant=variant,
        )
