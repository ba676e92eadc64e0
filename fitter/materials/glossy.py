"""How a glossy material is fitted: its free vector, where a search for it begins, and which of its numbers count."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.materials.coordinates import REACH, UNIT, Coordinates, Interval, WidthInterval
from fit_material.fitter.materials.fittable import Fittable
from fit_material.fitter.materials.linear_starts import share, widths
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.shaders.materials.glossy import Glossy
from fit_material.shaders.materials.kinds import GLOSSY as KIND
from fit_material.shaders.materials.quantities import ALPHA, COLOR, F0, REFLECTANCE
from fit_material.shaders.materials.widths import Width

PLASTIC = 0.04  # the reflectance of most dielectrics, of index 1.5
DIELECTRIC = Interval(1e-3, 0.5)  # reflectance, of an index of 1.065 on; diamond's is 0.17. What mirrors less is matte


@dataclass(frozen=True)
class GlossyCoordinates(Coordinates[Glossy]):
    """The free vector of a glossy material: colour per channel, reflectance, width, each inside its interval.

    Attributes:
        width: the interval of alpha or ρ.
        reflectance: the interval of reflectance.
        channels: 3, or 1 where the channels share one reflectance, as a dielectric's nearly do.
    """

    width: WidthInterval
    reflectance: Interval = UNIT
    channels: int = 3

    @property
    def sizes(self) -> Mapping[str, int]:
        return {COLOR.name: 3, REFLECTANCE.name: self.channels, "width": 1}

    def material(self, x: Float[Tensor, " x"]) -> Glossy:
        x = x.clamp(-REACH, REACH)
        reflectance = self.reflectance.value(x[self.slices[REFLECTANCE.name]]).expand(3)
        return Glossy(UNIT.value(x[self.slices[COLOR.name]]), reflectance, self.width.width(x[self.slices["width"]]))

    def free(self, material: Glossy) -> Float[Tensor, " x"]:
        color = UNIT.free(UNIT.inside(material.color))
        reflectance = self.reflectance.free(self.reflectance.inside(material.reflectance[: self.channels]))
        return torch.cat([color, reflectance, self.width.free_width(material.width)])


def start(model: PixelModel, photograph: Float[Tensor, "p 3"], weight: Float[Tensor, "p 3"]) -> Glossy:
    """A plastic of reflectance 0.04, whose colour is then a linear fit to what its reflection leaves over."""
    reflectance, half = torch.full((3,), PLASTIC).double(), torch.full((3,), 0.5).double()
    tried: list[tuple[float, Glossy]] = []
    for width in widths(model):
        black = model.radiance(Glossy(torch.zeros_like(half), reflectance, width))
        grey = model.radiance(Glossy(half, reflectance, width)) - black
        color = (share(grey, photograph - black, weight) * half).clamp(0.02, 0.95)
        material = Glossy(color, reflectance, width)
        tried.append((float(((model.radiance(material) - photograph) * weight).abs().mean()), material))
    return min(tried, key=lambda each: each[0])[1]


def half_reflecting(width: Width) -> Glossy:
    """A plastic whose body reflects half of the light."""
    return Glossy(torch.full((3,), 0.5).double(), torch.full((3,), PLASTIC).double(), width)


def coordinates(start: Glossy, width: WidthInterval, fidelity: Fidelity) -> GlossyCoordinates:
    """The unknowns; outside the viewer's model dielectrics reflect all channels alike."""
    return GlossyCoordinates(width, UNIT, 3) if fidelity.blurs else GlossyCoordinates(width, DIELECTRIC, 1)


def foreseen(width: WidthInterval) -> GlossyCoordinates:
    """The unknowns of a dielectric."""
    return GlossyCoordinates(width, DIELECTRIC, 1)


def examples(width: Width) -> dict[str, Glossy]:
    """Grey plastic."""
    return {f"plastic of alpha {width.value:g}": half_reflecting(width)}


GLOSSY = Fittable(
    KIND,
    coordinates,
    start,
    half_reflecting,
    examples,
    essential=(COLOR, F0, ALPHA),
    decisive=(COLOR, F0, ALPHA),
    foreseen=foreseen,
)
