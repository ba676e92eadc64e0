"""The noise of Mitsuba's photographs, measured from independent passes of the same renders."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import uniform_filter

from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.files.atomic import write_bytes_atomically
from fit_material.renderer.geometry.mesh import Sphere, read_mesh
from fit_material.renderer.mitsuba.conversion import bsdf_of
from fit_material.renderer.path_tracing.path_tracer import passes
from fit_material.renderer.synthesis.camera_placement import views
from tests.bench.photographs import Case

PASSES, SAMPLES = 64, 8
WINDOW = 3  # pixels along a side, over which relative variances are averaged
SEED = 20_000  # far from the photographs' own
COVERED = 1 - 1e-3


@dataclass(frozen=True)
class Noise:
    """Mean and covariance of the estimate that one sample makes of each pixel.

    Attributes:
        mean: radiance, [v, h, w, 3].
        covariance: of the channels, which share their samples' paths, [v, h, w, 3, 3].
        freedom: degrees of freedom behind each covariance, [v, h, w]; 0 where the object does not cover the pixel.
    """

    mean: Float[np.ndarray, "v h w 3"]
    covariance: Float[np.ndarray, "v h w 3 3"]
    freedom: Float[np.ndarray, "v h w"]


def noise_of(case: Case, variant: str, window: int = WINDOW) -> Noise:
    """Noise of a case's photographs without what is added to them; measured where it is not kept from an earlier run.

    A sample variance s² of ν degrees of freedom makes 1/s² too large by ν/(ν - 2), and one pixel's is fooled by rare
    bright samples that its passes have missed. Relative variances, s²/L², change slowly over a picture: they are
    averaged over neighbours, which multiplies ν by their number.
    """
    case = replace(case, noise=0.0)
    kept = case.measured(f"noise-{PASSES}x{SAMPLES}", variant)
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        file = io.BytesIO()
        np.savez_compressed(file, **_measured(pictures_of(case, variant, [SAMPLES] * PASSES)))  # type: ignore[arg-type]
        write_bytes_atomically(kept, file.getvalue())
    with np.load(kept) as found:
        return _smooth(found["mean"].astype(float), found["covariance"].astype(float), found["covered"], window)


def pictures_of(
    case: Case, variant: str, samples: list[int], seed: int = SEED
) -> Iterator[Iterator[Float[np.ndarray, "h w 4"]]]:
    """For each view of a case independent pictures, with so many samples a pixel; float32, coverage comes last."""
    options = case.options(variant)
    shape = Sphere() if options.mesh is None else read_mesh(options.mesh)
    environment, bsdf = read_environment(options.env), bsdf_of(options.material)  # type: ignore[arg-type] — one metal
    for index, view in enumerate(views(options.views, shape, options.fov)):
        camera = view.camera(options.size)
        yield passes(shape, camera, environment, bsdf, samples, seed=seed + index, variant=variant)


def _measured(pictures: Iterator[Iterator[Float[np.ndarray, "h w 4"]]]) -> dict[str, np.ndarray]:
    """Mean, covariance of one sample, and which pixels the object covers wholly."""
    found = [_moments(np.stack(list(each))) for each in pictures]
    return {key: np.stack([each[key] for each in found]) for key in found[0]}


def _moments(runs: Float[np.ndarray, "m h w 4"]) -> dict[str, np.ndarray]:
    mean = runs[..., :3].mean(0, dtype=np.float64)
    off = (runs[..., :3] - mean).astype(np.float32)
    covariance = SAMPLES / (len(runs) - 1) * np.einsum("mhwi,mhwj->hwij", off, off)
    covered = np.all(runs[..., 3] >= COVERED, axis=0)
    return {"mean": mean.astype(np.float32), "covariance": covariance, "covered": covered}


def _smooth(
    mean: Float[np.ndarray, "v h w 3"],
    covariance: Float[np.ndarray, "v h w 3 3"],
    covered: Bool[np.ndarray, "v h w"],
    window: int,
) -> Noise:
    """Relative covariances averaged over the covered pixels of a window."""
    scale = mean[..., :, None] * mean[..., None, :]
    known = covered & (mean > 0).all(-1)
    relative = np.where(known[..., None, None], covariance / np.where(scale > 0, scale, 1), 0.0)
    size = (1, window, window)
    count = uniform_filter(known.astype(float), size, mode="constant")  # type: ignore[arg-type] — a size per axis
    total = uniform_filter(relative, (*size, 1, 1), mode="constant")  # type: ignore[arg-type]
    averaged = total / np.where(known, count, 1)[..., None, None]
    freedom = np.where(known, (PASSES - 1) * np.rint(count * window**2), 0.0)
    return Noise(mean, averaged * scale, freedom)
