"""Our GGX and Beckmann pictures against Mitsuba's `roughconductor`, pixel by pixel."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.options.fidelity import preset
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.synthesis.camera_placement import views
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.support.paths import SHARED

SIZE, REPEATS, SPP, SAMPLES = 96, 4, 4096, 4096


def rows(variant: str) -> Iterator[str]:
    """Lines of a Markdown table."""
    mitsuba = f"Mitsuba ({variant}) {REPEATS} × {SPP} samples a pixel"
    yield f"Sphere, {SIZE}², gold, covered pixels; {mitsuba}, ours {SAMPLES}."
    yield ""
    yield "| environment | lobe | alpha | mean difference R, G, B | standard error | z² per pixel | pixels |"
    yield "|---|---|---|---|---|---|---|"
    for environment in ("studio_small_03", "rooitou_park", "st_peters_square_night"):
        for lobe, alpha in (("ggx", 0.05), ("ggx", 0.2), ("ggx", 0.5), ("beckmann", 0.2)):
            yield _row(environment, lobe, alpha, variant)


def _row(environment_name: str, lobe: str, alpha: float, variant: str) -> str:
    environment = read_environment(SHARED / "env" / f"{environment_name}_1k.hdr")
    gold = metal("Au")
    camera = views(1, Sphere())[0].camera(SIZE)
    bsdf = conductor(gold.n, gold.k, alpha, lobe)  # type: ignore[arg-type]
    runs = np.stack(
        [render(Sphere(), camera, environment, bsdf, spp=SPP, seed=seed, variant=variant) for seed in range(REPEATS)]
    ).astype(np.float64)
    covered = (runs[..., 3] > 1 - 1e-6).all(0)
    runs = runs[:, covered, :3]
    theirs, their_error = runs.mean(0), runs.std(0, ddof=1) / np.sqrt(REPEATS)

    row, column = torch.from_numpy(covered).nonzero().T
    surface = gbuffer.pixel_footprints(gbuffer.tracer(Sphere()), camera, column, row, 4)
    lighting = Lighting(environment, (), preset("standard", lobe))  # type: ignore[arg-type]
    table = lighting.table(surface, (alpha * 0.999, alpha * 1.001, 1), SAMPLES)
    pixels = lighting.pixels(surface, body=False)
    truth = Metal(
        *(torch.tensor(v, dtype=torch.float64) for v in (gold.n, gold.k)), Microfacet(torch.tensor(alpha).double())
    )
    whole, a, b = (pixels.under(each).radiance(truth).numpy() for each in (table, table.half(0), table.half(1)))
    our_error = np.abs(a - b) / 2

    difference = whole - theirs
    # Neighbouring pixels share nothing, so that the error of the mean falls with their number; both errors of one
    # pixel are themselves estimates from few numbers, so that they are pooled over pixels of like brightness.
    variance = _pooled(their_error**2 + our_error**2, theirs)
    mean = difference.mean(0) / theirs.mean(0)
    error = np.sqrt(variance.mean(0) / len(theirs)) / theirs.mean(0)
    z2 = (difference**2 / variance).mean()
    means = " ".join(f"{value:+.2%}" for value in mean)
    return f"| {environment_name} | {lobe} | {alpha} | {means} | {error.max():.2%} | {z2:.2f} | {len(theirs)} |"


def _pooled(variance: np.ndarray, radiance: np.ndarray, group: int = 64) -> np.ndarray:
    """Variances averaged over groups of pixels of neighbouring brightness, per channel."""
    pooled = np.empty_like(variance)
    for channel in range(3):
        order = np.argsort(radiance[:, channel])
        for part in np.array_split(order, max(1, len(order) // group)):
            pooled[part, channel] = variance[part, channel].mean()
    return pooled
