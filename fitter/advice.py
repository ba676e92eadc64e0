"""Advice in words and in JSON: which view, by how much it would shrink which intervals."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from fitter.result import FORMAT, FittedMaterial, MaterialType, NonNegative, Record, StandardErrors
from fitter.summary import CHANNELS
from fitter.viewpoints import Viewpoint
from renderer.studio import Vector

DECISIVE: Mapping[MaterialType, tuple[str, ...]] = {
    "metal": ("n", "k", "alpha"),
    "glossy": ("color", "f0", "alpha"),
    "matte": ("color",),
}
"""The numbers whose errors a further photograph is to shrink."""

HARDLY = 0.95  # of the errors that there are: a photograph that leaves so much is not worth its trouble

Ratios = Mapping[str, Float[Tensor, "v c"]]
"""By parameter, for each of v cases and each channel."""

HalfWidths = StandardErrors
"""Half of each 95 % interval, by parameter; None where there is none."""


@dataclass(frozen=True)
class Prospect:
    """One material as it was found, and how its errors would shrink.

    Attributes:
        material: with its intervals by the photographs that there are.
        ratio: the standard errors with one more view over those without it, for each of v views.
        finer: the same of a fit that takes more pixels of the photographs that there are; None where none does.
    """

    material: FittedMaterial
    ratio: Ratios
    finer: Ratios | None

    def score(self, ratios: Ratios) -> Float[Tensor, " v"]:
        """Logarithm of the geometric mean ratio over `DECISIVE`; the channels of a number count together as one."""
        return torch.stack([ratios[key].log().mean(1) for key in DECISIVE[self.material.type]]).mean(0)

    def now(self) -> HalfWidths:
        """Half widths as the fit has them."""
        return self._half_widths(lambda key, channel: 1.0)

    def expected(self, view: int) -> HalfWidths:
        """Half widths with one more view: as much narrower as the standard errors are smaller."""
        return self._half_widths(lambda key, channel: float(self.ratio[key][view, channel]))

    def _half_widths(self, factor) -> HalfWidths:
        def half(interval: tuple[float, float] | None, key: str, channel: int) -> float | None:
            return None if interval is None else factor(key, channel) * (interval[1] - interval[0]) / 2

        found = {}
        for key in self.ratio:
            intervals = getattr(self.material.interval95, key)
            if key == "alpha":
                found[key] = half(intervals, key, 0)
            elif intervals is not None:
                found[key] = tuple(half(each, key, channel) for channel, each in enumerate(intervals))
        return HalfWidths(**found)


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
    """The view that would tell most.

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
        best: the first of the candidates; None where no camera would see anything.
        candidates: all views that were looked at, the best one first.
    """

    format: Literal[1] = FORMAT
    message: str
    now: dict[str, HalfWidths]
    best: Best | None
    candidates: tuple[Candidate, ...]

    def json_text(self) -> str:
        return json.dumps(self.model_dump(mode="json"), allow_nan=False, ensure_ascii=False, indent=2)

    def text(self) -> str:
        """The sentence, and where the view helps, its camera to paste into scene.toml."""
        if self.best is None or self.best.ratio > HARDLY:
            return self.message
        return f"{self.message}\n\n{_camera_toml(self.best)}"


def advice_of(prospects: Sequence[Prospect], places: Sequence[Viewpoint], photographs: Sequence[str]) -> Advice:
    """The views in order, the one first that shrinks the intervals most, in the geometric mean over the materials.

    Args:
        prospects: at least one material.
        places: the views of their ratios.
        photographs: names of those that there are.
    """
    now = {prospect.material.name: prospect.now() for prospect in prospects}
    if not places:
        return Advice(message="No other camera sees the object.", now=now, best=None, candidates=())
    ratios = _mean(prospects, [prospect.ratio for prospect in prospects])
    order = ratios.argsort().tolist()
    candidates = tuple(Candidate(**_camera(places[i], float(ratios[i]))) for i in order)
    first = int(ratios.argmin())
    best = Best(
        **_camera(places[first], float(ratios[first])),
        nearest_view=photographs[places[first].nearest],
        expected={prospect.material.name: prospect.expected(first) for prospect in prospects},
    )
    message = _sentence(prospects, first, best, places[first].bearing, len(places))
    return Advice(message=message, now=now, best=best, candidates=candidates)


def _mean(prospects: Sequence[Prospect], ratios: Sequence[Ratios]) -> Float[Tensor, " v"]:
    """Geometric mean over the materials."""
    scores = [prospect.score(each) for prospect, each in zip(prospects, ratios, strict=True)]
    return torch.stack(scores).mean(0).exp()


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


def _sentence(prospects: Sequence[Prospect], view: int, best: Best, bearing: str, count: int) -> str:
    x, y, z = best.origin
    where = f"{best.angle_to_nearest_view:.0f}° to the {bearing} of {best.nearest_view}, origin ({x:g}, {y:g}, {z:g})"
    average = f"the intervals of {_decisive(prospects)} to {_percent(best.ratio)} on average"
    if best.ratio > HARDLY:
        return f"No further view helps much: the best of {count}, {where}, would leave {average}.{_remedy(prospects)}"
    worst = _worst(prospects, view)
    return f"A photograph from {where}, would shrink {worst} and {average}."


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _decisive(prospects: Sequence[Prospect]) -> str:
    """n, k and alpha."""
    keys = list(dict.fromkeys(key for prospect in prospects for key in DECISIVE[prospect.material.type]))
    return " and ".join([", ".join(keys[:-1]), keys[-1]] if len(keys) > 1 else keys)


def _remedy(prospects: Sequence[Prospect]) -> str:
    """Where the photographs have more pixels than the fit took, they can tell more without any further one."""
    finer = [prospect.finer for prospect in prospects if prospect.finer is not None]
    if len(finer) < len(prospects):
        return ""
    ratio = float(_mean(prospects, finer))
    return (
        f" More pixels of those you have would: --fidelity reference, to {_percent(ratio)}." if ratio <= HARDLY else ""
    )


def _worst(prospects: Sequence[Prospect], view: int) -> str:
    """What is known least, relative to its value, and would be: "k of red from ±0.8 to ±0.3,"."""
    widths = []
    for prospect in prospects:
        now, then = prospect.now(), prospect.expected(view)
        owner = f" of {prospect.material.name}" if len(prospects) > 1 else ""
        for key in DECISIVE[prospect.material.type]:
            rows = zip(
                *map(_as_list, (getattr(prospect.material, key), getattr(now, key), getattr(then, key))), strict=True
            )
            for channel, (value, before, after) in enumerate(rows):
                if before is not None:
                    name = key if _shared(prospect.material, key) else f"{key} of {CHANNELS[channel]}"
                    told = f"{name}{owner} from ±{before:.2g} to ±{after:.2g}"
                    widths.append((before / max(abs(value), 1e-12), told))
    return f"{max(widths)[1]}," if widths else "what is not known at all,"


def _shared(material: FittedMaterial, key: str) -> bool:
    """Whether all channels have one number, as a dielectric's F0."""
    return key == "alpha" or (material.type, key) == ("glossy", "f0")


def _as_list(value) -> list:
    return list(value) if isinstance(value, tuple) else [value]


def _camera_toml(view: Candidate) -> str:
    """The view as a table of scene.toml."""
    lens = f"fov = {view.fov}"
    if view.projection == "orthographic":
        lens = f'projection = "orthographic"\nscale = {view.scale}'
    pose = "\n".join(f"{key} = {list(getattr(view, key))}" for key in ("origin", "target", "up"))
    return f'[[photographs]]\nimage = "NEW.exr"\n[photographs.camera]\n{pose}\n{lens}'
