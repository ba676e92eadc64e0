"""Synthetic photographs for the benchmarks, rendered once and kept outside the tree."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path

from fitter.catalogue import metal
from renderer.synth import SynthOptions, synthesise
from renderer.truth import TrueMetal
from tests.bench.setting import CACHE, SHARED

METALS = ("Au", "Cu", "Al", "Fe")
ALPHAS = (0.05, 0.2, 0.5)
ENVIRONMENTS = ("studio_small_03", "rooitou_park", "st_peters_square_night")
SHAPES = {
    "sphere": None,
    "icosphere": SHARED / "meshes" / "icosphere5.obj",
    "spot": SHARED / "meshes" / "spot" / "spot_triangulated.obj",
}


@dataclass(frozen=True)
class Case:
    """One metal object in one light: three views of 128² pixels, 512 samples each."""

    metal: str
    alpha: float
    environment: str = "studio_small_03"
    shape: str = "sphere"

    def scene(self, variant: str) -> Path:
        """The scene file; renders the photographs where they are not kept from an earlier run."""
        options = self.options(variant)
        key = hashlib.sha256(repr(sorted(asdict(options).items(), key=str)).encode()).hexdigest()[:16]
        folder = CACHE / f"{self.shape}-{self.metal}-{self.alpha:g}-{self.environment}-{key}"
        scene = folder / "scene.toml"
        return scene if scene.exists() else synthesise(options, folder, lambda what, share: None)

    def options(self, variant: str) -> SynthOptions:
        """What `synth` is asked for."""
        known = metal(self.metal)
        return SynthOptions(
            TrueMetal(known.n, known.k, self.alpha, metal=known.name, source=known.source),
            mesh=SHAPES[self.shape],
            env=str(SHARED / "env" / f"{self.environment}_1k.hdr"),
            size=128,
            spp=512,
            variant=variant,
        )
