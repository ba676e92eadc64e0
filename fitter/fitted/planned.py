"""A fit with the plan of effects that it followed."""

from __future__ import annotations

from dataclasses import dataclass

from fit_material.fitter.effects.plan import Plan
from fit_material.fitter.effects.planner import Planner
from fit_material.fitter.fitted.part import FittedPart


@dataclass(frozen=True)
class PlannedFit:
    """What was fitted, and by which plan.

    Attributes:
        parts: the materials.
        plan: the last one.
        told: what the plan changed after the fit, in sentences.
        planner: which made it.
    """

    parts: list[FittedPart]
    plan: Plan
    told: list[str]
    planner: Planner
