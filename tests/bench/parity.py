"""The GL viewer's pictures against torch's, under every combination of effects: the worst of each material."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fit_material.renderer.opengl import offscreen
from fit_material.renderer.opengl.context import offscreen_context
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.viewer_model import shading
from fit_material.renderer.viewer_model.viewer_light import Surroundings, surroundings
from tests.support import parity

SIZE = 512
QUANTILE = 0.999


@dataclass(frozen=True)
class Outcome:
    """One pair of pictures: the relative difference at the quantile and at the worst of the pixels that both cover."""

    case: parity.Case
    typical: float
    worst: float
    one_sided: int


def rows(variant: str) -> Iterator[str]:
    """Lines of a Markdown table; Mitsuba's variant is of no matter here."""
    far = surroundings(studio(256))
    yield f"Torus, {SIZE}², with and without light, normal map, occlusion map and captured neighbours; OpenGL by"
    yield f"{offscreen_context().info['GL_RENDERER']}; relative difference to torch in float64 of covered pixels."
    yield ""
    yield "| material | pictures | 99.9th percentile: median, worst | under | worst pixel | covered in one only |"
    yield "|---|---|---|---|---|---|"
    outcomes = []
    for material in parity.MATERIALS:
        every = [_outcome(_case(material, effects), far) for effects in itertools.product(*[(False, True)] * 4)]
        outcomes += every
        yield _row(material, every)
    yield ""
    yield f"- worst of all: {max(each.typical for each in outcomes):.1e} (goal {parity.TOLERANCE:g})"


def _case(material: str, effects: Sequence[bool]) -> parity.Case:
    """As tests/shaders/test_glsl_parity.py has them: a colour map comes with the light."""
    return parity.Case(material, *effects, color_map=material != "metal" and effects[0])


def _outcome(case: parity.Case, far: Surroundings) -> Outcome:
    model, light, camera = case.model(), case.surroundings(far), parity.camera(SIZE)
    drawn = offscreen.render(model, camera, light, sky=False, antialias=1)
    return _compared(case, drawn, shading.render(model, camera, light).numpy())


def _compared(case: parity.Case, drawn: Float[np.ndarray, "h w 4"], expected: Float[np.ndarray, "h w 4"]) -> Outcome:
    both = (drawn[..., 3] == 1) & (expected[..., 3] == 1)
    error = parity.relative_error(drawn, expected)[both]
    one_sided = int((drawn[..., 3] != expected[..., 3]).sum())
    return Outcome(case, float(np.quantile(error, QUANTILE)), float(error.max()), one_sided)


def _row(material: str, outcomes: Sequence[Outcome]) -> str:
    worst = max(outcomes, key=lambda each: each.typical)
    middle, pixel = float(np.median([each.typical for each in outcomes])), max(each.worst for each in outcomes)
    effects = str(worst.case).removeprefix(material).strip("-") or "nothing else"
    most = max(each.one_sided for each in outcomes)
    return f"| {material} | {len(outcomes)} | {middle:.1e}, {worst.typical:.1e} | {effects} | {pixel:.1e} | {most} |"
