"""Pictures that are laid over a surface by its texture coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import require_file
from fit_material.renderer.images import image_file
from fit_material.renderer.images.samples import FORMATS, read_any


@dataclass(frozen=True)
class Texture:
    """Texels, repeated without end; looked up bilinearly, without mip levels.

    Attributes:
        texels: float32 [h, w, c], rows downwards as in the file; (u, v) = (0, 0) is the lower left corner.
    """

    texels: Float[Tensor, "h w c"]


def read_texture(path: str | Path, *, color: bool) -> Texture:
    """Read a picture file as a texture of three channels; grey is repeated thrice, alpha left out.

    Args:
        path: what `images.read_image` reads, where 16-bit PNG keeps its bits, and whatever else Pillow does (GIF,
            TGA, WebP, BMP, …); the first picture of several.
        color: integers are decoded from sRGB to linear Rec. 709; otherwise they are numbers, the largest code 1.
            Floats are taken as they are.

    Raises:
        InputError: the file is missing or broken, or a texel is not in [0, 1].
    """
    path = Path(path)
    require_file(path, "a texture")
    texels = torch.from_numpy(_read(path, None if color else "linear").radiance).contiguous()
    outside = ~((texels >= 0) & (texels <= 1))  # nan is outside, too
    if outside.any():
        raise InputError(path, "texel", texels[outside][0].item(), "numbers in [0, 1] in a texture")
    return Texture(texels)


def _read(path: Path, encoding: str | None) -> image_file.Image:
    if path.suffix.lower() in FORMATS:
        return image_file.read_image(path, encoding)
    return image_file.decoded(read_any(path), path, encoding)


def lookup(texture: Texture, uv: Float[Tensor, "*p 2"]) -> Float[Tensor, "*p c"]:
    """The texture's values, as GL_LINEAR and GL_REPEAT find them where the last row is uploaded first.

        x = w·frac(u) - ½,   y = h·(1 - frac(v)) - ½        [OpenGL 4.6 core, §8.14.3, rows counted from the top]

    and between the four texels around (x, y), which go on at the opposite edge, bilinearly.

    Args:
        texture: any number of channels.
        uv: texture coordinates, finite, any range.

    Returns:
        values in the texels' dtype; differentiable with respect to texels and uv.
    """
    texels = texture.texels
    height, width = texels.shape[:2]
    u, v = (uv - uv.detach().floor()).unbind(-1)
    column, right = _cell(u * width - 0.5)
    row, below = _cell((1 - v) * height - 0.5)
    upper, lower = (
        torch.lerp(texels[i, column % width], texels[i, (column + 1) % width], right.to(texels))
        for i in (row % height, (row + 1) % height)
    )
    return torch.lerp(upper, lower, below.to(texels))


def texel_weights(
    height: int, width: int, uv: Float[Tensor, "*p 2"]
) -> tuple[Int[Tensor, "*p 4"], Float[Tensor, "*p 4"]]:
    """How `lookup` mixes a texture: four texels for each place, counted row by row from the top, and their weights."""
    u, v = (uv - uv.floor()).unbind(-1)
    column, right = _cell(u * width - 0.5)
    row, below = _cell((1 - v) * height - 0.5)
    across, down = torch.cat([1 - right, right], -1), torch.cat([1 - below, below], -1)
    rows = torch.stack([row, row + 1], -1) % height
    columns = torch.stack([column, column + 1], -1) % width
    index = rows[..., :, None] * width + columns[..., None, :]
    return index.flatten(-2), (down[..., :, None] * across[..., None, :]).flatten(-2)


def _cell(position: Float[Tensor, "*p"]) -> tuple[Int[Tensor, "*p"], Float[Tensor, "*p 1"]]:
    """The texel at or before a position along one axis, and how far towards the next one it lies, in [0, 1)."""
    before = position.detach().floor()
    return before.long(), (position - before)[..., None]
