"""The data and means of a fit: pixels, light, and the tables that rounds of least squares need."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

from jaxtyping import Int
from torch import Tensor

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import PixelModel, central
from fit_material.fitter.forward.rotated_environment import TURNS, joined, turned
from fit_material.fitter.forward.textured_pixels import MultiViewPixels
from fit_material.fitter.least_squares.noise import neighbours_of, relative_weight
from fit_material.fitter.least_squares.nuisances import SCANNED, Nuisances, RotationBracket
from fit_material.fitter.least_squares.solvers import Solver
from fit_material.fitter.observations.pixel_selection import Observations
from fit_material.fitter.options.fidelity import BLUR_RANGE, MICROFACET_RANGE, Fidelity
from fit_material.fitter.options.progress import Progress
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.shaders.materials.kinds import KINDS, MaterialType


@dataclass(frozen=True)
class Problem:
    """What is to be explained, and by which means.

    Attributes:
        observed: the pixels.
        lighting: the light, and how accurately to compute it.
        solver: least squares.
        progress: called with the stage and the fraction of it done.
        nuisances: parameters beside the material's; None where there are none.
        corrected: of a model of the pixels, the model with what it leaves out; None where nothing is added.
    """

    observed: Observations
    lighting: Lighting
    solver: Solver
    progress: Progress
    nuisances: Nuisances | None = field(default=None, kw_only=True)
    corrected: Callable[[PixelModel], PixelModel] | None = field(default=None, kw_only=True)

    @property
    def settings(self) -> tuple[Lighting, ...]:
        """The light as it is; or under the turns of the environment between which its rotation is fitted."""
        turn = None if self.nuisances is None else self.nuisances.turn
        if turn is None:
            return (self.lighting,)
        return tuple(self.lighting.turned(turn.centre + each * turn.step) for each in TURNS)

    def at_rotation(self, turn: RotationBracket) -> Problem:
        """The same with the environment's rotation to be fitted there."""
        assert self.nuisances is not None
        return replace(self, nuisances=replace(self.nuisances, turn=turn))

    @cached_property
    def rotation_candidates(self) -> tuple[Problem, ...]:
        """Where the environment's rotation is to be fitted: the same with each of a few, which is not; else none."""
        if self.nuisances is None or self.nuisances.turn is None:
            return ()
        rest = self.nuisances.without_turn()
        return tuple(replace(self, lighting=self.lighting.turned(each), nuisances=rest) for each in SCANNED)

    @property
    def fidelity(self) -> Fidelity:
        return self.lighting.fidelity

    @property
    def roughness_range(self) -> tuple[float, float]:
        """The range of roughness."""
        return BLUR_RANGE if self.fidelity.blurs else MICROFACET_RANGE

    def table(self, span: tuple[float, float], levels: int, samples: int, stage: str) -> LightTable:
        report = functools.partial(self.progress, stage)
        asked = (self.observed.surface, (*span, levels), samples, report)
        return joined([lighting.table(*asked) for lighting in self.settings])

    @cached_property
    def on_search_pixels(self) -> Problem:
        """The same with the search's pixels alone, of which all are measured."""
        measured = self.observed.measured
        every = max(1, round(len(measured.radiance) / self.fidelity.search_pixels))
        return self if every == 1 and measured is self.observed else replace(self, observed=measured[::every])

    @cached_property
    def neighbours(self) -> Int[Tensor, "p q"]:
        """Of each pixel, those measured that are most like it."""
        return neighbours_of(central(self.observed.surface), left_out=self.observed.bounded)

    @cached_property
    def search_table(self) -> LightTable:
        """A coarse table over all roughnesses, which all types share."""
        return self.table(self.roughness_range, self.fidelity.search_levels, self.fidelity.search_samples, "searching")

    @cached_property
    def _surface(self) -> PixelModel:
        return turned([lighting.pixels(self.observed.surface, body=False) for lighting in self.settings])

    @cached_property
    def _body(self) -> PixelModel:
        observed = self.observed
        model = turned([lighting.pixels(observed.surface, body=True) for lighting in self.settings])
        if observed.point is None:
            return model
        return MultiViewPixels(model, observed.point, observed.radiance, relative_weight(observed.radiance))

    def pixels(self, kind: MaterialType) -> PixelModel:
        """The pixels' model, with what that type calls for and nothing else, and without a table so far."""
        model = self._body if KINDS[kind].has_body else self._surface
        return model if self.corrected is None else self.corrected(model)
