"""Photographs that show nothing, next to nothing, or the same again."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitter.hard_cases import small_scene
from fitter.hard_cases.claims import refused, within
from fitter.hard_cases.row import Claim, Numbers, Row
from fitter.hard_cases.small_scene import PIXELS, Told
from fitter.loading import repeated
from fitter.photographs import Photograph, read_photograph
from fitter.uncertainty import spread
from renderer.checked import check
from renderer.images import write_exr
from renderer.scene import PhotographSpec

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


def _told_apart(numbers: Numbers) -> list[int]:
    """Of a hundred identical photographs and one by another camera, those that are taken for new."""
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "view.exr"
        write_exr(image, EVEN)
        cameras = [CAMERA] * 100 + [{**CAMERA, "fov": 30.0}]
        tables = ({"image": str(image), "camera": camera} for camera in cameras)
        specs = [check(PhotographSpec, each, Path(folder) / "scene.toml") for each in tables]
        return sorted(set(range(101)) - repeated(specs))


def _with(value: float) -> Float[np.ndarray, "h w 3"]:
    made = EVEN.copy()
    made[1, 2] = value
    return made


def _left_out(found: Photograph, numbers: Numbers) -> str | None:
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


def _front() -> Tensor:
    return (small_scene.surface().n_dot_v[:, 0] > 0.8).nonzero()[:, 0]


def _noise(photograph: Tensor) -> Tensor:
    return 0.01 * torch.randn(photograph.shape, generator=torch.Generator().manual_seed(3)).to(photograph)


def _outlier(photograph: Tensor) -> Tensor:
    return photograph.index_fill(0, torch.tensor([17]), 1e6)


def _black_channel(photograph: Tensor) -> Tensor:
    return photograph * photograph.new_tensor([1.0, 1.0, 0.0])


def undetermined(*keys: str, words: str) -> Any:
    """The claim that these numbers are not determined, the status does not hide it, and the message says why."""

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


def _moved(change: Callable[[Tensor], Tensor], pixels: Tensor | None = None) -> Callable[[Numbers], float]:
    """Standard errors by which a change moves the fit, the most of all unknowns."""

    def moved(numbers: Numbers) -> float:
        light = small_scene.table(numbers.dtype, numbers.device)
        photograph = small_scene.photograph(light)
        plain = small_scene.fitted(small_scene.residuals_of(light, photograph))
        changed = small_scene.residuals_of(light, change(photograph), pixels)
        errors = spread(plain.residuals, plain.x).covariance.diagonal().sqrt()
        return float(((small_scene.fitted(changed).x - plain.x) / errors).abs().max())

    return moved


ROWS = (
    Row(
        "all-clipped",
        "no pixel says anything but 'brighter than this'",
        "PNG of 255",
        read(np.full((4, 4, 3), 255, np.uint8)),
        (refused("clipped throughout"),),
        "a refusal",
    ),
    Row(
        "all-black",
        "no light at all",
        "PNG of 0",
        read(np.zeros((4, 4, 3), np.uint8)),
        (refused("black inside the mask"),),
        "a refusal",
    ),
    Row(
        "all-nan",
        "no number at all",
        "EXR of NaN",
        read(np.full((4, 4, 3), np.nan, np.float32)),
        (refused("NaN or infinite throughout"),),
        "a refusal",
    ),
    Row(
        "beyond-float32",
        "squares leave float32",
        "EXR of 1e30",
        read(np.full((4, 4, 3), 1e30, np.float32)),
        (refused("radiance of 1e+30"),),
        "a refusal",
    ),
    Row(
        "one-nan",
        "one NaN is in every sum",
        "EXR with one pixel of NaN",
        read(_with(np.nan)),
        (Claim("left out and counted", _left_out),),
        "15 pixels of 16",
    ),
    Row(
        "one-infinite",
        "∞ - ∞",
        "EXR with one pixel of ∞",
        read(_with(np.inf)),
        (Claim("left out and counted", _left_out),),
        "15 pixels of 16",
    ),
    Row(
        "one-pixel",
        "three numbers for seven unknowns",
        "one pixel at 55°",
        seen(pixels=torch.tensor([40])),
        (FINITE_RESULT, undetermined("f0", "n", "k", "alpha", words="only 1 pixels show it")),
        "counting: nothing is determined",
        once=True,
    ),
    Row(
        "no-grazing-pixel",
        "n and k part only near grazing angles",
        "pixels with n·v > 0.8",
        lambda numbers: seen(pixels=_front())(numbers),
        (FINITE_RESULT, undetermined("n", "k", words="no pixel beyond")),
        "MODEL.md 1: curves of equal F0 differ beyond 60°",
        once=True,
    ),
    Row(
        "nothing-but-noise",
        "half of the pixels are negative, and the median is none",
        "noise of 0.01 about 0",
        seen(_noise),
        (FINITE_RESULT, undetermined("n", "k", "alpha", words="photographs and fit differ by")),
        "no light, no verdict",
        once=True,
    ),
    Row(
        "one-black-channel",
        "relative noise of nothing: a weight of 1/0",
        "blue is 0 everywhere",
        seen(_black_channel),
        (
            FINITE_RESULT,
            Claim(
                "honest",
                lambda found, numbers: None if found.material.f0[2] < 0.05 else f"F0 of blue is {found.material.f0[2]}",
            ),
        ),
        "F0 of blue is 0",
        once=True,
    ),
    Row(
        "one-outlier",
        "a pixel of 1e6 among pixels of 1 outweighs all others squared",
        "one pixel of ninety is 1e6",
        _moved(_outlier),
        (within(lambda numbers: 1.0, "robust"),),
        "the fit without it: less than a standard error, of which Huber's loss leaves 6/√90 = 0.6",
    ),
    Row(
        "a-hundred-identical-files",
        "noise that is counted a hundred times makes errors ten times too small",
        "one file in a hundred tables, and once more by another camera",
        _told_apart,
        (Claim("honest", lambda found, numbers: None if found == [0, 100] else f"takes {found} for new ones"),),
        "counting: the first of them and the other camera's",
        once=True,
    ),
    Row(
        "a-photograph-again",
        "the same pixels twice",
        "every pixel twice",
        _moved(lambda photograph: photograph, torch.arange(PIXELS).repeat(2)),
        (within(lambda numbers: 0.05, "invariant"),),
        "the fit of one; the prior weighs half",
    ),
    Row(
        "a-photograph-a-hundred-times",
        "100 identical photographs",
        "every pixel a hundred times",
        _moved(lambda photograph: photograph, torch.arange(PIXELS).repeat(100)),
        (within(lambda numbers: 0.1, "invariant"),),
        "the fit of one; the prior weighs a hundredth",
        once=True,
    ),
)
