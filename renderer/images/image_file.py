"""Images: files to linear radiance and back; `renderer.images.samples` reads what files store."""

from __future__ import annotations

import re
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Num, UInt, UInt8

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import replaced_together
from fit_material.renderer.images.camera_raw import ENDINGS
from fit_material.renderer.images.exif import read_exif, upright
from fit_material.renderer.images.exr import write_channels
from fit_material.renderer.images.samples import Samples, read_samples, read_sensor

ENCODING = re.compile(r"srgb|linear|gamma:(?=.*[1-9])(\d+(?:\.\d+)?)")
ENCODING_HELP = '"srgb", "linear" or "gamma:" and a positive exponent such as "gamma:2.2"'

WHITE, LOSSY_WHITE = 253.5 / 255, 247.5 / 255  # half a code below 254 and 248 of 255, where clipping is recognised by
LOSSY = (".jpg", ".jpeg")
WITH_EXIF = (*LOSSY, ".png", ".tif", ".tiff")


@dataclass(frozen=True)
class Image:
    """A picture in memory.

    Attributes:
        radiance: linear Rec. 709, float32 [h, w, 3]; negative or non-finite where the file is.
        alpha: coverage in [0, 1], float32 [h, w]; None where the file has no such channel.
        white: the radiance from which on a sample may be clipped; None for floating-point files, which do not clip.
        lossy: the file is compressed by blocks, so that a clipped pixel's neighbours are wrong, too.
        full: of camera raw, pixels whose photosite was full; None for other files, whose `white` decides.
    """

    radiance: Float[np.ndarray, "h w 3"]
    alpha: Float[np.ndarray, "h w"] | None = None
    white: float | None = None
    lossy: bool = False
    full: Bool[np.ndarray, "h w"] | None = None


def read_image(path: str | Path, encoding: str | None = None) -> Image:
    """Read an image file as linear radiance.

    Args:
        path: .exr, .hdr, .npy, .png, .jpg, .jpeg, .tif, .tiff, or camera raw (`renderer.images.camera_raw.ENDINGS`).
        encoding: "srgb", "linear" or "gamma:2.2"; None takes integer samples for sRGB, floats and raw for linear.

    Returns:
        The image, rotated by its EXIF orientation; the largest integer code becomes 1, and alpha is never decoded
        by the curve.

    Raises:
        InputError: the file is missing, broken or of another format, or the encoding is not one of these.
    """
    path = Path(path)
    if path.suffix.lower() in ENDINGS:
        return _developed(path, encoding)
    samples = read_samples(path)
    if samples.dtype.kind not in "uf":
        raise InputError(path, "sample type", samples.dtype, "unsigned integers or floats")
    if path.suffix.lower() in WITH_EXIF:
        samples = upright(samples, read_exif(path).orientation)
    return decoded(samples, path, encoding)


def _developed(path: Path, encoding: str | None) -> Image:
    """A camera raw file, which is linear and nothing else."""
    if encoding not in (None, "linear"):
        raise InputError(path, "encoding", repr(encoding), '"linear" or none: camera raw has no curve')
    radiance, full = read_sensor(path)
    return Image(radiance, full=full)


def decoded(samples: Samples, path: Path, encoding: str | None = None) -> Image:
    """Samples as a file stores them, unsigned integers or floats, as linear radiance; see `read_image`."""
    if samples.ndim not in (2, 3) or 0 in samples.shape or samples.shape[2:] not in ((), (1,), (2,), (3,), (4,)):
        raise InputError(path, "shape", list(samples.shape), "[height, width] or [height, width, 1 to 4 channels]")
    colour, alpha = _split_alpha(samples.reshape(*samples.shape[:2], -1))
    coverage = None if alpha is None else _values(alpha)
    if samples.dtype.kind != "u":
        return Image(_decode(_three(_values(colour)), encoding or "linear", path), coverage)
    encoding, lossy = encoding or "srgb", path.suffix.lower() in LOSSY
    white = _white(LOSSY_WHITE if lossy else WHITE, encoding, path)
    return Image(_decode_codes(colour, encoding, path), coverage, white, lossy)


def write_exr(path: str | Path, pixels: Float[np.ndarray, "h w c"]) -> None:
    """Write linear radiance as a 32-bit EXR file, whole or not at all.

    Args:
        path: where to; an existing file is replaced only once the new one is complete.
        pixels: [h, w, 3] RGB or [h, w, 4] RGB and alpha.

    Raises:
        InputError: where the folder cannot be written to.
    """
    path = Path(path)
    channels = {"RGBA"[: pixels.shape[2]]: np.ascontiguousarray(pixels, np.float32)}
    with replaced_together(path.parent, option=str(path)) as folder:
        write_channels(folder / path.name, channels)


def png(codes: UInt8[np.ndarray, "h w c"]) -> bytes:
    """Three or four channels of codes as a PNG file."""
    from PIL import Image  # imageio would load all of its formats, for a third of a second

    file = BytesIO()
    Image.fromarray(np.ascontiguousarray(codes)).save(file, "png")
    return file.getvalue()


def _values(samples: Samples) -> Float[np.ndarray, "h w *c"]:
    """Samples as floats, of which the largest integer code is 1; infinite where a file of doubles leaves float32."""
    with np.errstate(over="ignore"):
        values = samples.astype(np.float32, copy=False)
    return values / np.float32(np.iinfo(samples.dtype).max) if samples.dtype.kind == "u" else values


def _split_alpha(
    values: Num[np.ndarray, "h w c"],
) -> tuple[Num[np.ndarray, "h w c"], Num[np.ndarray, "h w"] | None]:
    """Colour or grey, and the alpha channel, which is the last of two or four."""
    channels = values.shape[2]
    alpha = values[..., -1] if channels in (2, 4) else None
    return values[..., : 3 if channels >= 3 else 1], alpha


def _three(values: Float[np.ndarray, "h w c"]) -> Float[np.ndarray, "h w 3"]:
    """Colour as it is, grey thrice."""
    return values if values.shape[2] == 3 else np.repeat(values, 3, axis=2)


def _decode(colour: Float[np.ndarray, "h w 3"], encoding: str, path: Path) -> Float[np.ndarray, "h w 3"]:
    """Undo the encoding curve. Negative samples, as only floats have, keep their sign under a gamma."""
    match = ENCODING.fullmatch(encoding)
    if match is None:
        raise InputError(path, "encoding", repr(encoding), ENCODING_HELP)
    if match[1]:
        return np.sign(colour) * np.abs(colour) ** np.float32(match[1])
    return colour if encoding == "linear" else _srgb_to_linear(colour)


def _decode_codes(colour: UInt[np.ndarray, "h w c"], encoding: str, path: Path) -> Float[np.ndarray, "h w 3"]:
    """The same of integers: where they have fewer codes than a picture samples, each code is decoded once."""
    if colour.dtype.itemsize > 2 or colour.size < (count := np.iinfo(colour.dtype).max + 1):
        return _decode(_three(_values(colour)), encoding, path)
    codes = np.arange(count, dtype=colour.dtype)[None, :, None]
    return _three(_decode(_three(_values(codes)), encoding, path)[0, :, 0][colour])


def _white(share: float, encoding: str, path: Path) -> float:
    """The radiance that a share of the largest code stands for."""
    return float(_decode(np.full((1, 1, 3), share, np.float32), encoding, path)[0, 0, 0])


def _srgb_to_linear(colour: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
    import torch
    from kornia.color import rgb_to_linear_rgb

    return rgb_to_linear_rgb(torch.from_numpy(colour).movedim(-1, -3)).movedim(-3, -1).numpy()
