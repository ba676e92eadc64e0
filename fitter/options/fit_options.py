"""Options of a fit beside its scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from fit_material.fitter.options.fidelity import PRESETS, Fidelity

Prior = Literal["none", "catalogue"]


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes:
        fidelity: a preset, or one's own.
        solver: "lm", "adam" or "lbfgs".
        seed: of the choice of pixels and of the integration.
        device: where light tables are integrated, in torch's words.
        command: the command line, for the report.
        type: of the materials that the scene file leaves open: "metal", "glossy", "matte", or "auto".
        prior: "catalogue" where known metals are to stand in for n and k that the photographs leave open.
        polish: whether metals are fitted once more with Mitsuba's paths, whatever the plan decides.
        tolerance: relative movement that no determined number is to exceed, in (0, 1): pixels, samples and levels are
            then what it takes; None where they are the fidelity's.
        refine_pose: whether the cameras are moved to where outlines and pixels agree before anything is fitted.
        check: whether to check the input before.
        maps: textures to recover: "color", or none.
        wanted, unwanted: effects of `shaders.effects` that are simulated, or not, whatever the plan's verdict.
    """

    fidelity: Fidelity = PRESETS["standard"]
    solver: str = "lm"
    seed: int = 0
    device: str = "cpu"
    command: str = ""
    type: str = "auto"
    prior: Prior = "none"
    polish: bool = False
    tolerance: float | None = None
    wanted: tuple[str, ...] = ()
    unwanted: tuple[str, ...] = ()
    refine_pose: bool = False
    check: bool = False
    maps: tuple[str, ...] = ()
