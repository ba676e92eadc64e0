"""Pixels in an environment that is rotated a little about +Y: the picture as a smooth function of the angle.

    L(t) = L₀ + ½(L₊ - L₋) t + ½(L₊ - 2L₀ + L₋) t²

Tables are integrated for three turns, one step apart, with the same random numbers; the parabola through them is the
picture between, and its slope the rotation's column of the Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.pixel_model import MixedPixels, PixelModel
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.shaders.materials.types import Material

TURNS = (-1, 0, 1)  # steps


@dataclass(frozen=True)
class TurnedPixels(MixedPixels):
    """The same pixels under three turns of the environment, and between.

    Attributes:
        turns: the models of L₋, L₀, L₊, of one kind.
        table: theirs, one after another; see `joined`.
        t: where between them, in steps.
    """

    turns: tuple[PixelModel, PixelModel, PixelModel]
    table: LightTable | None
    t: Float[Tensor, ""]

    def at(self, t: Float[Tensor, ""]) -> TurnedPixels:
        return replace(self, t=t)

    def under(self, table: LightTable | None) -> TurnedPixels:
        parts = [None] * 3 if table is None else _parts(table)
        first, middle, last = (model.under(part) for model, part in zip(self.turns, parts, strict=True))
        return replace(self, turns=(first, middle, last), table=table)

    def radiance(self, material: Material) -> Float[Tensor, "p 3"]:
        """Radiance of every pixel."""
        parts = _parabola(*(model.radiance(material) for model in self.turns))
        return parts[0] + self.t * parts[1] + self.t**2 * parts[2]

    def mixing(self, material: Material) -> Float[Tensor, "q 3"] | None:
        """The mixing of one turn, thrice: as it is, by t, and by t²."""
        middle = self.turns[1]
        found = middle.mixing(material) if isinstance(middle, MixedPixels) else None
        return None if found is None else torch.cat([found, self.t * found, self.t**2 * found])

    def mixed(self, pixels: slice) -> Float[Tensor, "p q 3"]:
        """The parabola's coefficients."""
        found = [model.mixed(pixels) for model in self.turns if isinstance(model, MixedPixels)]
        return torch.cat(_parabola(*found), 1)


def turned(models: Sequence[PixelModel]) -> PixelModel:
    """One model as it is; three as the turns of a `TurnedPixels`, in the middle."""
    if len(models) == 1:
        return models[0]
    first, middle, last = models
    return TurnedPixels((first, middle, last), None, torch.zeros((), dtype=torch.float64))


def joined(tables: Sequence[LightTable]) -> LightTable:
    """The tables of several turns as one of as many times the pixels."""
    if len(tables) == 1:
        return tables[0]
    return replace(tables[0], light=torch.cat([each.light for each in tables], 2))


def _parts(table: LightTable) -> list[LightTable]:
    return [replace(table, light=light) for light in table.light.chunk(len(TURNS), 2)]


def _parabola(first: Tensor, middle: Tensor, last: Tensor) -> list[Tensor]:
    return [middle, (last - first) / 2, (last - 2 * middle + first) / 2]
