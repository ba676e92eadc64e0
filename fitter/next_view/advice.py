"""Advice on the next photograph: all views that could be taken, in order, in JSON and in words."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Literal

from fit_material.fitter.next_view.candidate_views import Viewpoint
from fit_material.fitter.next_view.expected_gain import ExpectedGain, HalfWidths, geometric_mean
from fit_material.fitter.next_view.wording import helps, sentence
from fit_material.fitter.result.schema import FORMAT, NonNegative, Record
from fit_material.renderer.geometry.bounds import Vector


class Candidate(Record):
    """A view that could be taken, in the words of `[photographs.camera]`.

    Attributes:
        ratio: geometric mean of expected half widths over the present ones.
        angle_to_nearest_view: degrees between the directions of this view and of the nearest photograph.
    """

    origin: Vector
    target: Vector
    up: Vector
    fov: float
    projection: Literal["perspective", "orthographic"]
    scale: float | None
    ratio: NonNegative
    angle_to_nearest_view: NonNegative


class Best(Candidate):
    """The most informative view.

    Attributes:
        nearest_view: the photograph whose direction is nearest.
        expected: half widths with this view, by material.
    """

    nearest_view: str
    expected: dict[str, HalfWidths]


class Advice(Record):
    """What `fit-material advise --json` prints: strict JSON.

    Attributes:
        message: all of it in a sentence.
        now: half widths of the 95 % intervals of the photographs that there are, by material.
        best: the first of the candidates.
        candidates: all views that were looked at, the best one first.
    """

    format: Literal[1] = FORMAT
    message: str
    now: dict[str, HalfWidths]
    best: Best
    candidates: tuple[Candidate, ...]

    def json_text(self) -> str:
        return json.dumps(self.model_dump(mode="json"), allow_nan=False, ensure_ascii=False, indent=2)

    def text(self) -> str:
        """The sentence, and where the view helps, its camera to paste into scene.toml."""
        if not helps(self.best.ratio):
            return self.message
        return f"{self.message}\n\n{_camera_toml(self.best)}"


def advice_of(prospects: Sequence[ExpectedGain], places: Sequence[Viewpoint], photographs: Sequence[str]) -> Advice:
    """The views in order, the one first that shrinks the intervals most, in the geometric mean over the materials.

    Args:
        prospects: at least one material.
        places: the views of their ratios, at least one.
        photographs: names of those that there are.
    """
    now = {prospect.material.name: prospect.now() for prospect in prospects}
    ratios = geometric_mean(prospects, [prospect.ratio for prospect in prospects])
    order = ratios.argsort().tolist()
    candidates = tuple(Candidate(**_camera(places[i], float(ratios[i]))) for i in order)
    first = int(ratios.argmin())
    best = Best(
        **_camera(places[first], float(ratios[first])),
        nearest_view=photographs[places[first].nearest],
        expected={prospect.material.name: prospect.expected(first) for prospect in prospects},
    )
    message = sentence(prospects, first, places[first], best.nearest_view, best.ratio)
    return Advice(message=message, now=now, best=best, candidates=candidates)


def _camera(place: Viewpoint, ratio: float) -> dict[str, Any]:
    spec = place.spec
    return {
        "origin": spec.origin,
        "target": spec.target,
        "up": spec.up,
        "fov": spec.fov,
        "projection": spec.projection,
        "scale": spec.scale if spec.projection == "orthographic" else None,
        "ratio": ratio,
        "angle_to_nearest_view": place.angle,
    }


def _camera_toml(view: Candidate) -> str:
    """The view as a table of scene.toml."""
    lens = f"fov = {view.fov}"
    if view.projection == "orthographic":
        lens = f'projection = "orthographic"\nscale = {view.scale}'
    pose = "\n".join(f"{key} = {list(getattr(view, key))}" for key in ("origin", "target", "up"))
    return f'[[photographs]]\nimage = "NEW.exr"\n[photographs.camera]\n{pose}\n{lens}'
