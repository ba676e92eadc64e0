"""How far the numbers of a fit are from those that are taken for right."""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path

from pydantic import ConfigDict

from fit_material.fitter.frontier.runs import Run
from fit_material.fitter.result.schema import FittedMaterial, KnownType
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.regular_files import read_text
from fit_material.renderer.files.validation import Checked, check
from fit_material.shaders.materials.kinds import MaterialType
from fit_material.shaders.materials.quantities import ALPHA, COLOR, F0, QUANTITIES, ROUGHNESS, K, N

TRUTH = "truth.json"
NUMBERS = tuple(quantity.name for quantity in (N, K, F0, ALPHA, COLOR))
Triple = tuple[float, float, float]
Values = Sequence[float | None]


class Reference(Checked):
    """The numbers of one material that are taken for right; None where it has none.

    Attributes:
        name, type: of the material.
        n, k, f0, color: per channel.
        alpha: microfacet width; with `roughness`, the viewer's ρ, where a picture was made by that.
    """

    model_config = ConfigDict(extra="ignore", strict=False)

    name: str
    type: KnownType
    n: Triple | None = None
    k: Triple | None = None
    f0: Triple | None = None
    alpha: float | None = None
    roughness: float | None = None
    color: Triple | None = None


class _TruthFile(Checked):
    model_config = ConfigDict(extra="ignore", strict=False)

    materials: tuple[Reference, ...]


def truth_beside(scene: Path) -> tuple[Reference, ...] | None:
    """The materials of `truth.json` beside the scene file; None where there is no such file.

    Raises:
        InputError: the file is no truth as `synth` writes it.
    """
    path = scene.with_name(TRUTH)
    if not path.exists():
        return None
    try:
        data = json.loads(read_text(path, "utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(path, expected=f"JSON as `fit-material synth` writes it ({error})") from error
    return check(_TruthFile, data, path).materials


def require_of_scene(truth: Sequence[Reference], materials: Sequence[str], scene: Path) -> None:
    """Refuse a truth that knows none of the scene's materials.

    Args:
        truth: of `truth_beside`.
        materials: the names of the scene's.
        scene: scene file.

    Raises:
        InputError: no name is the same.
    """
    told = [reference.name for reference in truth]
    if not set(told) & set(materials):
        expected = f"the name of a material of {scene}: {', '.join(materials)}; or no {TRUTH} there"
        raise InputError(scene.with_name(TRUTH), "materials[].name", ", ".join(told) or "[]", expected)


def gaps(runs: Sequence[Run], truth: Sequence[Reference]) -> tuple[str, ...]:
    """A sentence for each material that the runs have no errors of: another type came out, or the truth lacks it."""
    told = []
    for right in truth:
        named = [(run.rung, each.type) for run in runs for each in run.materials if each.name == right.name]
        other = [(rung, kind) for rung, kind in named if kind != right.type]
        if other:
            rungs, kinds = (", ".join(dict.fromkeys(part)) for part in zip(*other, strict=True))
            said = f"{right.name} is {right.type} in {TRUTH} but came out as {kinds} from {rungs}"
            told.append(f"{said}: no errors of it there.")
    known = {right.name for right in truth}
    lacking = dict.fromkeys(each.name for run in runs for each in run.materials if each.name not in known)
    return *told, *(f"{name} is not in {TRUTH}: the errors are without it." for name in lacking)


def consensus(runs: Sequence[Run]) -> tuple[Reference, ...]:
    """The medians of several runs, number by number, of the materials that all of them found of one type."""
    found = []
    for material in runs[0].materials if runs else ():
        same = [each for run in runs for each in run.materials if (each.name, each.type) == _identity(material)]
        if len(same) == len(runs):
            keys = (*NUMBERS, "roughness")
            medians = {key: _median([getattr(each, key) for each in same]) for key in keys}
            found.append(Reference.model_validate({"name": material.name, "type": material.type, **medians}))
    return tuple(found)


def errors(run: Run, references: Sequence[Reference]) -> dict[str, float | None]:
    """The error of each of `NUMBERS`, the largest over channels and materials; "worst" is the largest of all.

    n, k and alpha err relative to themselves; F0 and colour relative to the brightest channel, for a channel that is
    nearly black has no relative error worth the name. "picture" is the run's difference from the photographs. None
    where one side has no such number; where a material came out as one of another type, all of its errors are.
    """
    right = {reference.name: reference for reference in references}
    pairs = [(each, right[each.name]) for each in run.materials if each.name in right]
    pairs = [(found, reference) for found, reference in pairs if found.type == reference.type]
    made = {key: _largest(_error(key, found, reference) for found, reference in pairs) for key in NUMBERS}
    return {**made, "picture": run.picture, "worst": _largest(made.values())}


def _error(key: str, found: FittedMaterial, right: Reference) -> float | None:
    if key == ALPHA.name and right.alpha is None:
        key = ROUGHNESS.name
    values, wanted = (_channels(getattr(each, key)) for each in (found, right))
    if None in (*values, *wanted):
        return None
    largest = max(abs(value) for value in wanted) or 1.0  # type: ignore[type-var, arg-type] — no None among them
    scales = [largest if QUANTITIES[key] in (F0, COLOR) else abs(value) or largest for value in wanted]  # type: ignore[arg-type]
    pairs = zip(values, wanted, scales, strict=True)
    return max(abs(value - true) / scale for value, true, scale in pairs)  # type: ignore[operator]


def _channels(value: float | Triple | None) -> Values:
    return value if isinstance(value, tuple) else (value,)


def _largest(values: Iterable[float | None]) -> float | None:
    return max((value for value in values if value is not None), default=None)


def _identity(material: FittedMaterial) -> tuple[str, MaterialType]:
    return material.name, material.type


def _median(values: Sequence[float | Triple | None]) -> float | list[float] | None:
    if any(value is None for value in values):
        return None
    if isinstance(values[0], tuple):
        return [statistics.median(channel) for channel in zip(*values, strict=True)]  # type: ignore[arg-type]
    return statistics.median(values)  # type: ignore[type-var]
