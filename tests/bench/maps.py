"""The colour map of Spot under its own texture, from 12 photographs by Mitsuba, against that texture."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.images.textures import read_texture
from fit_material.renderer.materials.bsdf import diffuse, plastic
from tests.bench.photographs import SHAPES, map_of
from tests.bench.setting import CACHE
from tests.support.paths import SHARED
from tests.support.textured import photograph_textured, seen_at

VIEWS, SIZE, SPP = 12, 192, 512
ENVIRONMENT = "studio_small_03"
TEXTURE = SHARED / "meshes" / "spot" / "spot_texture.png"
ALPHA, REFLECTANCE = 0.15, 0.04
WITHIN = 0.03  # RMS over channels and texels that two photographs see or more, linear
DIRECT, WITH_INTERREFLECTION = 2, 8  # longest path of the photographs'
CASES = tuple((kind, depth) for depth in (DIRECT, WITH_INTERREFLECTION) for kind in ("matte", "glossy"))


@dataclass(frozen=True)
class Found:
    """A colour map that was found, beside the true one.

    Attributes:
        material: of the result.
        color: linear.
        truth: the mean of the true texture over each texel.
        photographs: that see each texel.
        seconds: of the whole fit.
    """

    material: FittedMaterial
    color: Float[np.ndarray, "h w 3"]
    truth: Float[np.ndarray, "h w 3"]
    photographs: Int[np.ndarray, "h w"]
    seconds: float

    def error(self, least: int, most: int) -> Float[np.ndarray, "n 3"]:
        """Of the texels that so many photographs see."""
        chosen = (self.photographs >= least) & (self.photographs <= most)
        return self.color[chosen] - self.truth[chosen]


def rows(variant: str, cases: Sequence[tuple[str, int]] = CASES) -> Iterator[str]:
    """A table, then whether the figure holds."""
    yield f"{VIEWS} photographs of {SIZE}² with {SPP} samples, {ENVIRONMENT}; errors are linear, over three channels."
    yield "Photographs by direct light alone, which no camera takes, are fitted `--without interreflection`."
    yield ""
    yield "| material | light | texels | seen by | texels | RMS | mean error | 95 % within | F0 | alpha | s |"
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    worst = 0.0
    for kind, depth in cases:
        found = _found(kind, depth)
        worst = max(worst, _rms(found.error(2, VIEWS)))
        yield from _lines(kind, depth, found)
    yield ""
    verdict = "holds" if worst <= WITHIN else "does not hold"
    yield f"Texels that two photographs see or more: {worst:.4f} RMS at worst; {WITHIN} {verdict}."


def _lines(kind: str, depth: int, found: Found) -> Iterator[str]:
    light = "direct" if depth == DIRECT else "with interreflection"
    side = len(found.color)
    for label, least, most in (("1", 1, 1), ("2 or more", 2, VIEWS)):
        error = found.error(least, most)
        within = float(np.quantile(np.abs(error), 0.95))
        first = f"| {kind} | {light} | {side}²" if most == 1 else "| | |"
        told = _shared(found.material) if most == 1 else "| |"
        seconds = f"{found.seconds:.0f}" if most == 1 else ""
        numbers = f"{len(error)} | {_rms(error):.4f} | {error.mean():+.4f} | {within:.3f}"
        yield f"{first} | {label} | {numbers} {told} | {seconds} |"


def _shared(material: FittedMaterial) -> str:
    if material.f0 is None or material.alpha is None:
        return "| – | –"
    errors = material.stderr
    f0 = f"{material.f0[0]:.4f} ± {(errors.f0 or (0.0,))[0] or 0:.4f} ({REFLECTANCE})"
    return f"| {f0} | {material.alpha:.4f} ± {errors.alpha or 0:.4f} ({ALPHA})"


def _rms(error: Float[np.ndarray, "n 3"]) -> float:
    return float(np.sqrt((error**2).mean()))


def _found(kind: str, depth: int) -> Found:
    texture = read_texture(TEXTURE, color=True).texels.numpy().astype(np.float64)
    scene = _photographs(kind, depth, texture)
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        unwanted = ("interreflection",) if depth == DIRECT else ()
        material = fit_scene(scene, Path(folder), FitOptions(maps=("color",), unwanted=unwanted)).materials[0]
        seconds = time.perf_counter() - begun
        assert material.maps is not None
        color = read_texture(Path(folder) / material.maps.color, color=True).texels.numpy()
        photographs = read_image(Path(folder) / material.maps.color_seen, "linear").radiance[..., 0]
    truth = seen_at(texture, len(color), 4)
    return Found(material, color, truth, np.round(255 * photographs).astype(int), seconds)


def _photographs(kind: str, depth: int, texture: Float[np.ndarray, "h w 3"]) -> Path:
    """The scene file; its photographs are made where they are not kept from an earlier run."""
    folder = CACHE / f"spot-texture-{kind}-{VIEWS}x{SIZE}-{SPP}-{depth}-{ENVIRONMENT}"
    white = (1.0, 1.0, 1.0)
    bsdf = diffuse(white) if kind == "matte" else plastic(white, REFLECTANCE, ALPHA)
    mesh = SHAPES["spot"]
    assert mesh is not None
    if not (folder / "scene.toml").exists():
        photograph_textured(
            folder, mesh, texture, bsdf, env=map_of(ENVIRONMENT), count=VIEWS, size=SIZE, spp=SPP, max_depth=depth
        )
    return folder / "scene.toml"
