"""Which files in a folder earlier fits have written, by the `result.json` there: those alone a fit may replace."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from fit_material.fitter.result.schema import OutputFile, Result, read_result
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.replaceable import Replaceable, contents, unchanged
from fit_material.renderer.files.unfinished import sweep

RESULT = "result.json"
PICTURES = ("report.html", "comparison.png")
TRANSFORMS = ".transforms.json"  # of the cameras that a fit moved
ENDINGS = (".mtl", ".thesis.mtl", TRANSFORMS)  # of files by versions that listed none
KNOWN = f"one that the {RESULT} there lists and nobody has changed"


def replaceable_by_fit(folder: Path, inputs: Iterable[Path]) -> Replaceable:
    """What a fit that reads `inputs` may replace in a folder, in which an interrupted one's files are moved first."""
    sweep(folder)
    return Replaceable(tuple(inputs), written_by_fit(folder), KNOWN)


def written_by_fit(folder: Path) -> dict[str, str | None]:
    """The files that earlier fits wrote into a folder, as its `result.json` lists them; none where there is none.

    Versions that listed nothing wrote the result's maps, and files called after an input: those are taken for theirs.
    """
    result = _result_in(folder)
    if result is None:
        return {}
    listed = [*(result.outputs or ()), *(result.earlier_outputs or ())]
    own: dict[str, str | None] = {file.path: file.sha256 for file in listed}
    return {RESULT: None, **(dict.fromkeys(_usual_names(result)) if result.outputs is None else {}), **own}


def _result_in(folder: Path) -> Result | None:
    path = folder / RESULT
    try:
        return read_result(path) if path.is_file() else None
    except (InputError, OSError):
        return None


def _usual_names(result: Result) -> list[str]:
    names = {"sphere", *(Path(file.path).stem for file in result.inputs)}
    maps = [material.maps for material in result.materials if material.maps is not None]
    called = [f"{name}{ending}" for name in sorted(names) for ending in ENDINGS]
    return [*PICTURES, *called, *(file for each in maps for file in (each.color, each.color_seen))]


def outputs_of(folder: Path, target: Path) -> dict[str, tuple[OutputFile, ...] | None]:
    """The fields of a result about files: `outputs` and `earlier_outputs`.

    Args:
        folder: what a fit has just filled, but for `result.json`, which cannot list itself.
        target: where its files go, with those of earlier fits.
    """
    new = contents(folder)
    earlier = {name: digest for name, digest in written_by_fit(target).items() if name not in {RESULT, *new}}
    return {"outputs": _files(new), "earlier_outputs": _files(unchanged(target, earlier)) or None}


def _files(digests: Mapping[str, str]) -> tuple[OutputFile, ...]:
    return tuple(OutputFile(path=name, sha256=digest) for name, digest in digests.items())
