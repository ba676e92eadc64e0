"""What is shown and how: all that a picture depends on beside the model and its surroundings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from fit_material.renderer.viewer.eye import Eye
from fit_material.shaders.tone_mapping import CURVES

Comparison = Literal["off", "beside", "swipe", "difference"]
COMPARISONS: tuple[Comparison, ...] = ("off", "beside", "swipe", "difference")


@dataclass(frozen=True)
class Look:
    """A choice of everything that the keys and the mouse change.

    Attributes:
        eye: where from.
        exposure: in stops.
        curve: one of `shaders.tone_mapping.CURVES`.
        sky: whether the surroundings are drawn behind the model.
        rotation: degrees by which the surroundings are rotated about +Y, beyond the turn that they came with.
        comparison: how the photograph is laid beside or over the picture.
        photograph: which one.
        edge: where the photograph ends and the render begins under "swipe", a share of the width.
        walking: first person.
    """

    eye: Eye
    exposure: float = 0.0
    curve: str = CURVES[0]
    sky: bool = True
    rotation: float = 0.0
    comparison: Comparison = "off"
    photograph: int = 0
    edge: float = 0.5
    walking: bool = False
