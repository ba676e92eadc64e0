"""Three sentences of advice, each computed from what was measured."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Iterator, Sequence

from fit_material.fitter.frontier.errors import NUMBERS, Reference
from fit_material.fitter.frontier.errors import errors as errors_of
from fit_material.fitter.frontier.pareto import Frontier
from fit_material.fitter.frontier.runs import Run
from fit_material.fitter.frontier.table import two_digits
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.result.schema import FittedMaterial
from tests.bench.accuracy_table import errors, rungs_of, seconds
from tests.bench.setting import spread

NEAR_ENOUGH = 2.0  # times the least error, within which the cheapest preset is the one to use
STEP = ("standard", "reference")
SYMBOLS = {"f0": "F0"}


def advice(
    frontiers: Sequence[Frontier], fits: Sequence[tuple[Sequence[Run], Sequence[Reference]]]
) -> tuple[str, str, str]:
    """Which preset for whom; what the step from standard to reference buys; what limits beyond.

    Args:
        frontiers: of all cases, the same rungs in each.
        fits: the runs behind each of them, and the truth.
    """
    return whom(frontiers), step(frontiers), beyond(frontiers, fits)


def whom(frontiers: Sequence[Frontier]) -> str:
    """The presets by their medians over the cases: the quickest that none beats, the sensible one, the nearest."""
    points = {
        name: (statistics.median(seconds(frontiers, name)), statistics.median(errors(frontiers, name)))
        for name in rungs_of(frontiers)
        if name in PRESETS
    }
    points = {name: point for name, point in points.items() if all(map(math.isfinite, point))}
    if not points:
        return "No preset found all materials."
    least = min(error for _, error in points.values())
    unbeaten = [name for name, at in points.items() if not any(_beats(other, at) for other in points.values())]
    enough = [name for name, (_, error) in points.items() if error <= NEAR_ENOUGH * least]
    roles = {
        "where every second counts": min(unbeaten, key=points.__getitem__),
        f"as the quickest within {NEAR_ENOUGH:g} times the least error": min(enough, key=points.__getitem__),
        "for the least error at any price": min(points, key=lambda name: points[name][1]),
    }
    return f"Take {'; '.join(_by_preset(roles, points))}."


def _beats(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] < other[0] and one[1] < other[1]


def _by_preset(roles: dict[str, str], points: dict[str, tuple[float, float]]) -> Iterator[str]:
    """Each preset once, with all that it is best for."""
    for name in dict.fromkeys(roles.values()):
        own = ", ".join(role for role, preset in roles.items() if preset == name)
        time, error = points[name]
        yield f"`{name}` (median {time:.1f} s, worst error {_percent(error)}) {own}"


def step(frontiers: Sequence[Frontier]) -> str:
    """What the dearer of two rungs costs and brings, case by case."""
    cheap, dear = STEP
    times = _ratios(seconds(frontiers, dear), seconds(frontiers, cheap))
    left = _ratios(errors(frontiers, dear), errors(frontiers, cheap))
    if not times or not left:
        return f"The step from {cheap} to {dear} was not measured."
    less = sum(ratio < 1 for ratio in left)
    return (
        f"The step from `{cheap}` to `{dear}` takes {spread(times)} times as long and leaves {spread(left)} times the"
        f" worst error, which falls in {less} of {len(left)} cases."
    )


def _ratios(dear: Sequence[float], cheap: Sequence[float]) -> list[float]:
    """Of the cases in which both are known, and the lower part not 0."""
    return [a / b for a, b in zip(dear, cheap, strict=True) if math.isfinite(a) and math.isfinite(b) and b > 0]


def beyond(frontiers: Sequence[Frontier], fits: Sequence[tuple[Sequence[Run], Sequence[Reference]]]) -> str:
    """Which number errs most on the finest rung, and whether the fit's own interval allows for that."""
    finest = rungs_of(frontiers)[-1]
    worst = [
        found
        for runs, truth in fits
        for run in runs
        if run.rung == finest and (found := worst_number(run, truth)) is not None
    ]
    if not worst:
        return f"What limits beyond `{finest}` cannot be told, for no fit there has an error."
    counts = Counter(SYMBOLS.get(key, key) for key, _ in worst).most_common()
    held = sum(holds for _, holds in worst)
    why = (
        "the photographs' own noise limits, and cleaner or more photographs help where effort does not"
        if 2 * held > len(worst)
        else "what limits is no noise that the fit knows of but the model or the integration"
    )
    return (
        f"Beyond `{finest}` the worst error is that of {_joined([f'{key} ({count})' for key, count in counts])},"
        f" {_percent(statistics.median(errors(frontiers, finest)))} in the median case, and the fit's own 95 % interval"
        f" holds the truth of that very number in {held} of {len(worst)} fits: {why}."
    )


def worst_number(run: Run, truth: Sequence[Reference]) -> tuple[str, bool] | None:
    """The number that errs most of all, and whether its 95 % interval holds the truth; None where none has an error."""
    found = {key: off for key in NUMBERS if (off := errors_of(run, truth)[key]) is not None}
    if not found:
        return None
    key = max(found, key=found.__getitem__)
    right = {reference.name: reference for reference in truth}
    channels = [each for material in run.materials for each in _channels(material, right[material.name], key)]
    return key, max(channels)[1]


def _channels(found: FittedMaterial, right: Reference, key: str) -> Iterator[tuple[float, bool]]:
    """Each channel's error, F0 and colour absolute, all else relative; and whether its interval holds the truth."""
    values, truths, intervals = (getattr(each, key) for each in (found, right, found.interval95))
    if values is None or truths is None:
        return
    if not isinstance(values, tuple):
        values, truths, intervals = (values,), (truths,), (intervals,)
    for value, true, interval in zip(values, truths, intervals or (None,) * len(values), strict=True):
        scale = 1.0 if key in ("f0", "color") or true == 0 else abs(true)
        yield abs(value - true) / scale, interval is not None and interval[0] <= true <= interval[1]


def _percent(share: float) -> str:
    return f"{two_digits(100 * share)} %" if math.isfinite(share) else "no number"


def _joined(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
