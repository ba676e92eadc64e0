"""Advice in a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from fit_material.fitter.fitted.summary import CHANNELS
from fit_material.fitter.materials.registry import FITTABLE
from fit_material.fitter.next_view.candidate_views import Viewpoint
from fit_material.fitter.next_view.expected_gain import ExpectedGain, geometric_mean
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.shaders.materials.kinds import KINDS
from fit_material.shaders.materials.quantities import ALPHA

HARDLY = 0.95  # of the errors that there are: a photograph that leaves so much is not worth its trouble


def helps(ratio: float) -> bool:
    """Whether a view that leaves this share of the intervals is worth the trouble."""
    return ratio <= HARDLY


def sentence(prospects: Sequence[ExpectedGain], view: int, place: Viewpoint, nearest: str, ratio: float) -> str:
    """What the best view would bring.

    Args:
        prospects: the materials.
        view: index of the best view in their ratios.
        place: where it is.
        nearest: name of the photograph nearest to it.
        ratio: of the intervals, on average.
    """
    x, y, z = place.spec.origin or (0.0, 0.0, 0.0)
    where = f"{place.angle:.0f}° to the {place.bearing} of {nearest}, origin ({x:g}, {y:g}, {z:g})"
    intervals = f"the intervals of {_decisive(prospects)}"
    if helps(ratio):
        return (
            f"A photograph from {where}, would shrink {_example(prospects, view)}{intervals} to {_on_average(ratio)}."
        )
    hardly = f"No further view helps much: the best, {where}, would leave {intervals} at {_on_average(ratio)}."
    return " ".join([hardly, *_remedy(prospects)])


def _on_average(share: float) -> str:
    return f"{100 * share:.0f} % of their width on average"


def _decisive(prospects: Sequence[ExpectedGain]) -> str:
    """n, k and alpha."""
    *others, last = dict.fromkeys(
        each.name for prospect in prospects for each in FITTABLE[prospect.material.type].decisive
    )
    return f"{', '.join(others)} and {last}" if others else last


def _remedy(prospects: Sequence[ExpectedGain]) -> list[str]:
    """Where the photographs have more pixels than the fit takes, a larger fit needs no further photograph."""
    finer = [prospect.finer for prospect in prospects if prospect.finer is not None]
    if len(finer) < len(prospects):
        return []
    ratio = float(geometric_mean(prospects, finer))
    remedy = f"A fit with --fidelity reference takes more pixels of the photographs there are: {_on_average(ratio)}."
    return [remedy] if helps(ratio) else []


@dataclass(frozen=True)
class _Number:
    """A number of a material with its half width, now and with the further view; `determined` as it is now."""

    name: str
    value: float
    now: float
    expected: float
    determined: bool

    @property
    def urgency(self) -> tuple[bool, float]:
        """What is not determined first, of it the least known; then what shrinks most."""
        if self.determined:
            return False, 1 - self.expected / max(self.now, 1e-300)
        return True, self.now / max(abs(self.value), 1e-12)


def _example(prospects: Sequence[ExpectedGain], view: int) -> str:
    """The most urgent number: "k of red from ±0.8 to ±0.3, and "; nothing where no number has an interval."""
    numbers = [
        number
        for prospect in prospects
        for each in FITTABLE[prospect.material.type].decisive
        for number in _numbers(prospect, view, each.name, f" of {prospect.material.name}" if len(prospects) > 1 else "")
    ]
    if not numbers:
        return ""
    first = max(numbers, key=lambda number: number.urgency)
    return f"{first.name} from ±{first.now:.2g} to ±{first.expected:.2g}, and "


def _numbers(prospect: ExpectedGain, view: int, key: str, owner: str) -> Iterator[_Number]:
    """The channels of a parameter that have intervals."""
    material = prospect.material
    parts = (material, prospect.now(), prospect.expected(view), material.determined)
    rows = zip(*(_channels(getattr(part, key)) for part in parts), strict=True)
    for channel, (value, now, expected, determined) in enumerate(rows):
        if now is not None and expected is not None:
            name = key if _is_shared(material, key) else f"{key} of {CHANNELS[channel]}"
            yield _Number(name + owner, value, now, expected, bool(determined))


def _is_shared(material: FittedMaterial, key: str) -> bool:
    """Whether all channels have one number, as a dielectric's F0."""
    return key == ALPHA.name or key in KINDS[material.type].same_as


def _channels(part: Any) -> tuple:
    return part if isinstance(part, tuple) else (part,)
