"""The fit of one of an object's materials."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.estimation.model_selection import Choice
from fit_material.fitter.fitted.determinability import Seen
from fit_material.fitter.fitted.summary import describe
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.least_squares.covariance import Covariance
from fit_material.fitter.metal_prior.borrowed import Borrowed, TooFar
from fit_material.fitter.observations.pixel_selection import Observations
from fit_material.fitter.result.schema import FittedMaterial, Tolerance
from fit_material.renderer.rays.gbuffer import GBuffer

if TYPE_CHECKING:
    from fit_material.fitter.effects.interreflection import Polish
    from fit_material.fitter.fitted.color_texture import ColorMap
    from fit_material.fitter.uncertainty.tolerance import Ascent


@dataclass(frozen=True)
class FittedPart:
    """The fit of one of the object's materials.

    Attributes:
        index: of the material among the mesh's.
        observed: its pixels.
        choice: its fit.
        spread: covariance of the fit's free vector.
        material: the numbers to report.
        lighting: the light, and how accurately it was computed.
        seen: what the photographs offered to the fit.
        borrowed: n and k as known metals suggest them, or why none do; None where not computed.
        remarks: on the fit, in sentences, in order of appearance.
        ascent: to the requested tolerance; None where none was.
        polish: with Mitsuba's paths; None where there was none.
        color_map: the texture of the body; None where it is taken for even.
    """

    index: int
    observed: Observations
    choice: Choice
    spread: Covariance
    material: FittedMaterial
    lighting: Lighting
    seen: Seen
    borrowed: Borrowed | TooFar | None = None
    remarks: tuple[str, ...] = ()
    ascent: Ascent | None = None
    polish: Polish | None = None
    color_map: ColorMap | None = None

    @property
    def tolerance(self) -> Tolerance | None:
        """How the requested tolerance was met; None where none was."""
        return None if self.ascent is None else self.ascent.record(self.material.name)

    @property
    def told(self) -> str:
        """The fit in sentences, by its numbers, and the remarks."""
        return " ".join([describe(self.choice, self.material, self.seen, self.borrowed), *self.remarks])

    def remarked(self, sentences: str) -> FittedPart:
        """The same with one remark more."""
        return replace(self, remarks=(*self.remarks, sentences))

    def by(self, ascent: Ascent) -> FittedPart:
        """The same, and how a tolerance was met."""
        return replace(self.remarked(ascent.sentence), ascent=ascent)


def shade_by_material(
    parts: Sequence[FittedPart],
    surface: GBuffer,
    radiance_of: Callable[[FittedPart, GBuffer], Float[Tensor, "p 3"]],
) -> Float[Tensor, "p 3"]:
    """Radiance of pixels [p, k], each by the part whose material it shows, float64."""
    radiance = torch.zeros(len(surface.hit), 3, dtype=torch.float64)
    for part in parts:
        own = surface.material[:, 0] == part.index
        if own.any():
            radiance[own] = radiance_of(part, surface[own])
    return radiance
