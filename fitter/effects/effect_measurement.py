"""By how much each effect moves the pixels of photographs: pictures with it and without, over materials that may be."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.effects.one_bounce import returned_light
from fit_material.fitter.effects.plan import Change
from fit_material.fitter.effects.plan_rules import RULES
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.least_squares.noise import relative_weight
from fit_material.fitter.materials.registry import FITTABLE
from fit_material.fitter.observations.album import Album
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.pixel_footprint import middle
from fit_material.renderer.rays.self_visibility import sees_itself
from fit_material.shaders.materials.types import Material
from fit_material.shaders.materials.widths import Microfacet, Width

PIXELS = 256  # fewer than one in eighty of all is then moved further than the most, with 95 % confidence
PHOTOGRAPHS = 8
SAMPLES = 4096  # by which no pixel of a mirror under small lamps seems to move by a hundredth
ALPHAS = (0.05, 0.2, 0.5)  # from polished to dull


@dataclass(frozen=True)
class Sample:
    """A few pixels of a scene's photographs, drawn evenly.

    Attributes:
        surface: [p, k] rays inside each.
        trace: of the object.
    """

    surface: GBuffer
    trace: Tracer

    @staticmethod
    def of(photographs: Album, trace: Tracer, footprint: int, seed: int) -> Sample:
        """Pixels that the object's front covers wholly, of some photographs."""
        every = max(1, math.ceil(len(photographs) / PHOTOGRAPHS))
        chosen = range(0, len(photographs), every)
        generator = torch.Generator().manual_seed(seed)
        found = []
        for index in chosen:
            photograph = photographs[index]
            row, column = photograph.mask.nonzero().T
            drawn = torch.randperm(len(row), generator=generator)[: 2 * math.ceil(PIXELS / len(chosen))]
            surface = gbuffer.pixel_footprints(trace, photograph.camera, column[drawn], row[drawn], footprint)
            found.append(surface[surface.front.all(-1)][: math.ceil(PIXELS / len(chosen))])
        return Sample(gbuffer.concatenate(found), trace)

    @cached_property
    def middles(self) -> GBuffer:
        """The middle ray of each pixel, [p]."""
        return middle(self.surface)[:, 0]

    @cached_property
    def self_seeing(self) -> float:
        """Share of the pixels that mirror the object itself."""
        return float(sees_itself(self.trace, self.middles).double().mean())


def possible(kinds: Collection[str], lobe: type[Width] = Microfacet) -> dict[str, Material]:
    """Materials of these types from polished to dull, by name; a blur's radii are the same numbers."""
    found: dict[str, Material] = {}
    for width in (lobe(torch.tensor(each, dtype=torch.float64)) for each in ALPHAS):
        for kind, fittable in FITTABLE.items():
            found |= fittable.examples(width) if kind in kinds else {}
    return found


@dataclass(frozen=True)
class Measurement:
    """Pictures of a sample with and without effects.

    Attributes:
        sample: the pixels.
        lighting: the light, with all effects that are not ruled out.
        materials: that may be there, by name.
        tolerance: relative change of a pixel that counts.
    """

    sample: Sample
    lighting: Lighting
    materials: Mapping[str, Material]
    tolerance: float

    def changes(self, names: Collection[str]) -> dict[str, Change]:
        """By how much each of these effects moves pixels."""
        return {name: self._change(name) for name in names}

    def _change(self, name: str) -> Change:
        pixels = len(self.sample.surface.hit)
        shown = [each for each in self.materials if self.shows(name, each)]
        if not shown or not pixels:
            return Change(0.0, 0.0, "none", pixels)
        moved = {each: self.moved(name, each) for each in shown}
        worst = max(moved, key=lambda each: float(moved[each].max()))
        share = float((moved[worst] > self.tolerance).double().mean())
        itself = f"{self.sample.self_seeing:.1%} of the pixels see the object itself"
        seen = itself if RULES[name].between_points else ""
        return Change(float(moved[worst].max()), share, worst, pixels, seen)

    def shows(self, name: str, material: str) -> bool:
        """Whether that material can show the effect."""
        return RULES[name].shown_by(self.materials[material])

    def moved(self, name: str, material: str) -> Float[Tensor, " p"]:
        """Relative change of each pixel."""
        whole, made = self._wholes[material], self.materials[material]
        if RULES[name].traced:
            returned = returned_light(self.sample.trace, self.sample.middles, self.lighting, made)
            return (returned * relative_weight(whole.mean(0) + returned)).amax(-1)
        without = self._halves(self.lighting.effects - {name}, made)
        return sure((whole - without) * relative_weight(torch.maximum(whole, without).mean(0))).amax(-1)

    @cached_property
    def _wholes(self) -> dict[str, Float[Tensor, "2 p 3"]]:
        """The pictures of all materials with all effects."""
        return {name: self._halves(self.lighting.effects, made) for name, made in self.materials.items()}

    def _halves(self, effects: frozenset[str], material: Material) -> Float[Tensor, "2 p 3"]:
        """The radiance of the sample with these effects, by either half of the integration's samples."""
        lighting, surface = self.lighting.simulating(effects), self.sample.surface
        key = (effects, material.has_body)
        if key not in self._bare:
            self._bare[key] = lighting.pixels(surface, body=key[1])
        of_table = frozenset(each for each in effects if RULES[each].changes_table)
        lobe = (of_table, None if material.width is None else float(material.width.value))
        if lobe not in self._tables:
            self._tables[lobe] = lighting.table_of(material, surface, SAMPLES)
        model = self._bare[key].under(self._tables[lobe])
        return torch.stack([model.half(which).radiance(material) for which in (0, 1)])

    @cached_property
    def _bare(self) -> dict[tuple[frozenset[str], bool], PixelModel]:
        """The sample's models without a table, which all materials share, by effects and whether there is a body."""
        return {}

    @cached_property
    def _tables(self) -> dict[tuple[frozenset[str], float | None], LightTable | None]:
        """The sample's light through the lobes, by the effects that change it and by roughness."""
        return {}


def sure(change: Float[Tensor, "2 p 3"]) -> Float[Tensor, "p 3"]:
    """How much of a change both halves of the integration show: the smaller one where they agree in sign, else none."""
    least = change.abs().amin(0)
    return torch.where(change[0] * change[1] > 0, least, 0 * least)
