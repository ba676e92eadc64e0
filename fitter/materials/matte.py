"""How a matte material is fitted: its free vector, where a search for it begins, and which of its numbers count."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.materials.coordinates import REACH, UNIT, Coordinates, Interval, WidthInterval
from fit_material.fitter.materials.fittable import Fittable
from fit_material.fitter.materials.linear_starts import share
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.renderer.materials.catalogue import DARKEST_MATTE
from fit_material.shaders.materials.kinds import MATTE as KIND
from fit_material.shaders.materials.matte import Matte
from fit_material.shaders.materials.quantities import COLOR, REFLECTANCE
from fit_material.shaders.materials.widths import Width

MATTE_REFLECTANCE = Interval(0.0, 1.5)  # the Lambertian, 1, lies inside: at an end no error could be stated


@dataclass(frozen=True)
class MatteCoordinates(Coordinates[Matte]):
    """The free vector of a matte material: colour per channel, and reflectance for all of them or for each.

    A reflectance above 1, which no material has, is for the fit alone: a surface that darkens towards grazing angles.
    `fitter.uncertainty.active_bound` determines the reported one.

    Attributes:
        channels: 1 or 3, of the reflectance.
        lambert: the free number of reflectance 1, which is a Lambertian's.
    """

    channels: int = 3
    width = None
    lambert: ClassVar[float] = float(MATTE_REFLECTANCE.free(torch.tensor(1.0, dtype=torch.float64)))

    @property
    def sizes(self) -> Mapping[str, int]:
        return {COLOR.name: 3, REFLECTANCE.name: self.channels}

    def material(self, x: Float[Tensor, " x"]) -> Matte:
        x = x.clamp(-REACH, REACH)
        return Matte(
            UNIT.value(x[self.slices[COLOR.name]]), MATTE_REFLECTANCE.value(x[self.slices[REFLECTANCE.name]]).expand(3)
        )

    def free(self, material: Matte) -> Float[Tensor, " x"]:
        color, reflectance = UNIT.inside(material.color), MATTE_REFLECTANCE.inside(material.reflectance)
        return torch.cat([UNIT.free(color), MATTE_REFLECTANCE.free(reflectance[: self.channels])])

    def beyond_lambert(self, x: Float[Tensor, " x"]) -> Bool[Tensor, " m"]:
        """Which of a material's own numbers are reflectances above 1."""
        color, reflectance = (x[self.slices[name]] for name in self.sizes)
        return torch.cat([torch.zeros_like(color, dtype=torch.bool), reflectance > self.lambert])


def start(model: PixelModel, photograph: Float[Tensor, "p 3"], weight: Float[Tensor, "p 3"]) -> Matte:
    """A surface that is nearly Lambertian, whose colour is then a linear fit."""
    white, reflectance = torch.ones(3).double(), torch.full((3,), 0.9).double()
    color = share(model.radiance(Matte(white, reflectance)), photograph, weight)
    return Matte(color.clamp(0.02, 0.98), reflectance)


def half_reflecting(width: Width | None) -> Matte:
    """A Lambertian that reflects half of the light."""
    return Matte(torch.full((3,), 0.5).double(), torch.ones(3).double())


def coordinates(start: Matte, width: WidthInterval | None, fidelity: Fidelity) -> MatteCoordinates:
    """The unknowns; in the viewer's model each channel has its reflectance."""
    return MatteCoordinates(channels=3 if fidelity.blurs else 1)


def foreseen(width: WidthInterval) -> MatteCoordinates:
    """The unknowns of a matte material with one reflectance."""
    return MatteCoordinates(channels=1)


def examples(width: Width) -> dict[str, Matte]:
    """Plaster."""
    white = torch.ones(3).double()
    return {"plaster": Matte(0.8 * white, white)}


MATTE = Fittable(
    KIND,
    coordinates,
    start,
    half_reflecting,
    examples,
    essential=(COLOR,),
    decisive=(COLOR,),
    foreseen=foreseen,
    darkest=(COLOR, DARKEST_MATTE),
)
