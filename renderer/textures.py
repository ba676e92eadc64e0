"""Pictures that are laid over a surface by its texture coordinates."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Texture:
    """Texels, repeated without end; looked up bilinearly, without mip levels.

    Attributes:
        texels: float32 [h, w, c], rows downwards as in the file; (u, v) = (0, 0) is the lower left corner.
    """

    texels: Float[Tensor, "h w c"]
