"""Radiance of a photograph's files: one exposure over its factor, or several merged into one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.exif import relative_exposure
from fit_material.renderer.images.image_file import Image, decoded, read_image
from fit_material.renderer.photographs.clipping import clipped_pixels
from fit_material.renderer.photographs.response_curve import CODES, Curve, fitted_response, through
from fit_material.renderer.scene.fittable_values import FITTED
from fit_material.renderer.scene.scene_file import PhotographSpec

NEUTRAL = (1.0, 1.0, 1.0)
TRIED = 20000  # pixels of a view, of which the curve is fitted to some that differ
CONTRADICTED = (
    1.5  # factor between exposures as declared and as seen; shutters err by a tenth, lamps flicker by some more
)
SEEN = 0.02  # of white, from which a pixel determines an exposure
ENOUGH = 50  # pixels that two exposures have to share, to be compared


@dataclass(frozen=True)
class Exposed:
    """A photograph as radiance.

    Attributes:
        radiance: linear Rec. 709, float32 [h, w, 3], pixels over the exposure; not finite, or 0, where `finite`
            says so.
        alpha: coverage in [0, 1], [h, w]; None where the file has no such channel.
        finite: pixels without NaN or infinity, [h, w].
        clipped: pixels that no exposure holds unclipped, or that have such neighbours, [h, w].
        white: the radiance, [3], from which on the shortest exposure's channels may be clipped; None for files of
            floats, which do not clip, and for camera raw, whose channels mix full and other photosites.
        exposure: what the pixels were divided by, 1 for a merged one; None where it is unknown, and 1 was taken. A
            white balance that is known was divided by, too.
    """

    radiance: Float[Tensor, "h w 3"]
    alpha: Float[Tensor, "h w"] | None
    finite: Bool[Tensor, "h w"]
    clipped: Bool[Tensor, "h w"]
    white: Float[Tensor, "3"] | None
    exposure: float | None


def expose(spec: PhotographSpec) -> Exposed:
    """Read the image or images of a photograph, as radiance but for what of exposure and white balance is unknown.

    Raises:
        InputError: a file cannot be read, has no EXIF where that is needed, or another size than the first one.
    """
    seen = _exposed(spec)
    if spec.white_balance in (FITTED, NEUTRAL):
        return seen
    gains = torch.tensor(spec.white_balance)
    return replace(seen, radiance=seen.radiance / gains, white=None if seen.white is None else seen.white / gains)


def _exposed(spec: PhotographSpec) -> Exposed:
    files = spec.images or (spec.image,)
    if spec.exposure == FITTED:
        return _single(read_image(spec.image, spec.encoding), 1.0, None)
    given = [relative_exposure(file) for file in files] if spec.exposure == "exif" else spec.exposure
    exposures = given if isinstance(given, list | tuple) else [given]
    if len(files) == 1:
        return _single(read_image(spec.image, spec.encoding), exposures[0], exposures[0])
    if spec.encoding == FITTED:
        return _merged(files, exposures, "linear", _response(files, exposures))
    return _merged(files, exposures, spec.encoding)


def _single(image: Image, factor: float, exposure: float | None) -> Exposed:
    radiance = torch.from_numpy(image.radiance)
    return Exposed(
        radiance / factor, _alpha(image), _finite(image), clipped_pixels(image), _white(image, factor), exposure
    )


def _response(files: Sequence[Path], exposures: Sequence[float]) -> Curve:
    """The camera's curve, from pixels by chance."""
    srgb = decoded(np.arange(CODES, dtype=np.uint8)[None], files[0]).radiance[0, :, 0]
    first = _codes(files[0])
    chosen = np.random.default_rng(0).choice(len(first), min(TRIED, len(first)), replace=False)
    others = []
    for file in files[1:]:
        codes = _codes(file)
        if len(codes) != len(first):
            raise InputError(file, "size", expected="as many pixels as the first exposure of this view has")
        others.append(codes[chosen])
    return fitted_response(np.stack([first[chosen], *others], 1), exposures, srgb, files[0])


def _codes(file: Path) -> Int[np.ndarray, "p 3"]:
    """The file's samples, of which 255 is the largest."""
    image = read_image(file, "linear")
    if image.white is None:
        raise InputError(file, "encoding", '"fit"', '"linear": files of floats and camera raw have no curve')
    return np.rint(image.radiance.reshape(-1, 3) * (CODES - 1)).astype(int)


def _merged(
    files: Sequence[Path], exposures: Sequence[float], encoding: str | None, curve: Curve | None = None
) -> Exposed:
    """The radiance that several exposures of one view agree on, each read in its turn.

        L = Σ pᵢ / Σ tᵢ    over the exposures t that are not clipped at the pixel

    Where noise is the light's own, var pᵢ ∝ tᵢ L, this is the mean weighed by 1/var(pᵢ/tᵢ), whatever the sensor's gain;
    and as the weights do not depend on the pixels, noise does not bias them [Hasinoff 2010, eq. 5, without read noise].
    """
    first = read_image(files[0], encoding)
    total = torch.zeros(first.radiance.shape)
    weight = torch.zeros(first.radiance.shape[:2])
    finite = torch.zeros(weight.shape, dtype=torch.bool)
    least, white = total, None  # the shortest exposure's, which is all that is known where each is clipped
    compared: list[Tensor] = []
    for index, (file, exposure) in enumerate(zip(files, exposures, strict=True)):
        image = first if index == 0 else read_image(file, encoding)
        _require_size(image, first, file)
        known = _finite(image)
        pixels = torch.from_numpy(image.radiance if curve is None else through(image.radiance, curve))
        pixels = torch.where(known[..., None], pixels, 0.0)
        usable = known & ~clipped_pixels(image)
        compared.append(_told(pixels, usable, image.white))
        total = total + usable[..., None] * pixels
        weight += usable * exposure
        finite |= known
        if exposure == min(exposures):
            least, white = pixels / exposure, _white(image, exposure, curve)
    _require_agreement(files, exposures, compared)
    unknown = weight == 0
    merged = torch.where(unknown[..., None], least, total / torch.where(unknown, 1.0, weight)[..., None])
    return Exposed(merged, _alpha(first), finite, finite & unknown, white, 1.0)


def _white(image: Image, factor: float, curve: Curve | None = None) -> Float[Tensor, "3"] | None:
    """The radiance of an exposure's white."""
    if image.white is None:
        return None
    white = np.full((1, 1, 3), image.white, np.float32)
    return torch.from_numpy(white if curve is None else through(white, curve))[0, 0] / factor


def _told(pixels: Float[Tensor, "h w 3"], usable: Bool[Tensor, "h w"], white: float | None) -> Float[Tensor, " t"]:
    """Some pixels' means over their channels, NaN where they determine no exposure."""
    step = max(1, round(math.sqrt(usable.numel() / TRIED)))
    mean = pixels[::step, ::step].mean(-1)
    darkest = 0.0 if white is None else SEEN * white
    return torch.where(usable[::step, ::step] & (mean > darkest), mean, torch.nan).flatten()


def _require_agreement(files: Sequence[Path], exposures: Sequence[float], told: Sequence[Float[Tensor, " t"]]) -> None:
    """That the exposures are about as the pixels show, from each to the next longer one."""
    order = sorted(range(len(files)), key=lambda index: exposures[index])
    for shorter, longer in pairwise(order):
        ratio = told[longer] / told[shorter]
        ratio = ratio[ratio.isfinite()]
        if len(ratio) < ENOUGH:
            continue
        seen, said = float(ratio.median()), exposures[longer] / exposures[shorter]
        if not 1 / CONTRADICTED <= seen / said <= CONTRADICTED:
            expected = f"about {seen:.3g} times that of {files[shorter].name}, by their pixels, not {said:.3g} times"
            raise InputError(files[longer], "exposure", f"{exposures[longer]:.4g}", expected)


def _require_size(image: Image, first: Image, file: Path) -> None:
    height, width = first.radiance.shape[:2]
    if image.radiance.shape[:2] != (height, width):
        found = f"{image.radiance.shape[1]} × {image.radiance.shape[0]} pixels"
        raise InputError(file, "size", found, f"{width} × {height} pixels, as the first exposure of this view has")


def _alpha(image: Image) -> Float[Tensor, "h w"] | None:
    return None if image.alpha is None else torch.from_numpy(image.alpha)


def _finite(image: Image) -> Bool[Tensor, "h w"]:
    """Pixels without NaN or infinity, of which integers have none."""
    radiance = torch.from_numpy(image.radiance)
    if image.white is not None:
        return torch.ones(radiance.shape[:2], dtype=torch.bool)
    return radiance.isfinite().all(-1)
