"""What is done with photographs that show nothing, next to nothing, or the same again."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.least_squares.covariance import sandwich_covariance
from fit_material.fitter.observations.photograph import Photograph, read_photograph
from fit_material.fitter.observations.scene_data import repeated
from fit_material.fitter.selftest.experiments import small_scene
from fit_material.fitter.selftest.experiments.row import Claim, Numbers
from fit_material.fitter.selftest.experiments.small_scene import Told
from fit_material.renderer.files.validation import check
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.scene.scene_file import PhotographSpec

CAMERA = {"origin": [0.0, 0.0, 4.0], "target": [0.0, 0.0, 0.0]}
EVEN = np.full((4, 4, 3), 0.5, np.float32)


def read(pixels: Any) -> Callable[[Numbers], Photograph]:
    """An experiment: a photograph of these pixels, 8-bit codes or floats, written and read."""

    def made(numbers: Numbers) -> Photograph:
        from imageio.v3 import imwrite

        with tempfile.TemporaryDirectory() as folder:
            codes = pixels.dtype == np.uint8
            image = Path(folder) / ("view.png" if codes else "view.exr")
            if codes:
                imwrite(image, pixels)
            else:
                write_exr(image, pixels)
            spec = check(PhotographSpec, {"image": str(image), "camera": CAMERA}, Path(folder) / "scene.toml")
            return read_photograph(spec, "scene.toml")

    return made


def told_apart(numbers: Numbers) -> list[int]:
    """Of a hundred identical photographs and one by another camera, those that are taken for new."""
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "view.exr"
        write_exr(image, EVEN)
        cameras = [CAMERA] * 100 + [{**CAMERA, "fov": 30.0}]
        tables = ({"image": str(image), "camera": camera} for camera in cameras)
        specs = [check(PhotographSpec, each, Path(folder) / "scene.toml") for each in tables]
        return sorted(set(range(101)) - repeated(specs))


def with_pixel(value: float) -> Float[np.ndarray, "h w 3"]:
    made = EVEN.copy()
    made[1, 2] = value
    return made


def left_out(found: Photograph, numbers: Numbers) -> str | None:
    """The one broken pixel is masked, counted, and 0."""
    if found.nonfinite != 1 or int(found.mask.sum()) != 15 or not found.radiance.isfinite().all():
        return f"left out {found.nonfinite} pixels and kept {int(found.mask.sum())}, expected 1 and 15, all finite"
    return None


def seen(change: Callable[[Tensor], Tensor] = lambda photograph: photograph, pixels: Tensor | None = None) -> Any:
    """An experiment: the small scene's photograph, changed, fitted by those pixels."""

    def made(numbers: Numbers) -> Told:
        light = small_scene.table(numbers.dtype, numbers.device)
        residuals = small_scene.residuals_of(light, change(small_scene.photograph(light)), pixels)
        return small_scene.told(residuals, pixels)

    return made


def front() -> Tensor:
    return (small_scene.surface().n_dot_v[:, 0] > 0.8).nonzero()[:, 0]


def only_noise(photograph: Tensor) -> Tensor:
    return 0.01 * torch.randn(photograph.shape, generator=torch.Generator().manual_seed(3)).to(photograph)


def one_outlier(photograph: Tensor) -> Tensor:
    return photograph.index_fill(0, torch.tensor([17]), 1e6)


def black_channel(photograph: Tensor) -> Tensor:
    return photograph * photograph.new_tensor([1.0, 1.0, 0.0])


def undetermined(*keys: str, words: str) -> Any:
    """The claim that these numbers are not determined, that status and message show it."""

    def sentence(found: Told, numbers: Numbers) -> str | None:
        known = [key for key in keys if np.any(getattr(found.material.determined, key))]
        if known:
            return f"calls {', '.join(known)} determined"
        if "f0" in keys and found.status == "converged":
            return "has the status converged without F0"
        return None if words in found.message else f"says {found.message!r}, expected the words {words!r}"

    return Claim("honest", sentence)


def _all_told_is_finite(found: Told, numbers: Numbers) -> str | None:
    """Every number of the result is finite, or there is none."""
    wrong = [value for value in _flat(found.material.model_dump()) if not np.isfinite(value)]
    return f"has {wrong[0]} in the result" if wrong else None


def _flat(nested: Any) -> list[float]:
    if isinstance(nested, dict):
        nested = list(nested.values())
    if isinstance(nested, list | tuple):
        return [value for each in nested for value in _flat(each)]
    return [float(nested)] if isinstance(nested, int | float) and not isinstance(nested, bool) else []


FINITE_RESULT = Claim("finite", _all_told_is_finite)


def moved_by(change: Callable[[Tensor], Tensor], pixels: Tensor | None = None) -> Callable[[Numbers], float]:
    """Standard errors by which a change moves the fit, the most of all unknowns."""

    def moved(numbers: Numbers) -> float:
        light = small_scene.table(numbers.dtype, numbers.device)
        photograph = small_scene.photograph(light)
        plain = small_scene.fitted(small_scene.residuals_of(light, photograph))
        changed = small_scene.residuals_of(light, change(photograph), pixels)
        errors = sandwich_covariance(plain.residuals, plain.x).covariance.diagonal().sqrt()
        return float(((small_scene.fitted(changed).x - plain.x) / errors).abs().max())

    return moved
