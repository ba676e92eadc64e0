"""What a batch notes beside a result: by which options and code it was made, so that it is not made again."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Literal

from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.result.provenance import code_digest, versions
from fit_material.fitter.result.schema import InputFile, Record, Result, read_result
from fit_material.fitter.result.written_files import replaceable_by_fit
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import write_text_atomically
from fit_material.renderer.files.digests import sha256_of
from fit_material.renderer.files.regular_files import read_text
from fit_material.renderer.files.replaceable import Replaceable
from fit_material.renderer.files.validation import check

FORMAT = 1
RECORD = "batch.json"  # in the result's folder, moved there last: whoever finds it finds all that it lists


class Fitted(Record):
    """One fit of a batch, ended and whole.

    Attributes:
        scene: its file.
        key: of options, code and versions.
        files: that the fit wrote, by name, with their SHA-256.
        worker: where it was fitted.
        starts: how many times it was started until it ended; more than one where processes died.
    """

    format: Literal[1] = FORMAT
    scene: str
    key: str
    files: dict[str, str]
    worker: str
    starts: int


def key_of(options: FitOptions) -> str:
    """What a result depends on beside the scene's files: the options, the code, and the versions that compute."""
    asked = {name: value for name, value in asdict(options).items() if name != "command"}
    text = json.dumps([FORMAT, asked, code_digest(), versions()], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def write_record(folder: Path, scene: Path, key: str, worker: str, starts: int) -> None:
    """Note that the files in `folder` are a whole result."""
    files = {path.name: sha256_of(path) for path in sorted(folder.iterdir()) if path.is_file()}
    record = Fitted(scene=str(scene), key=key, files=files, worker=worker, starts=starts)
    text = json.dumps(record.model_dump(mode="json"), allow_nan=False, ensure_ascii=False, indent=1)
    write_text_atomically(folder / RECORD, text + "\n")


def read_record(folder: Path) -> Fitted | None:
    """The note in that folder; None where it is missing or damaged: then the scene is fitted again."""
    try:
        return check(Fitted, json.loads(read_text(folder / RECORD, "utf-8")), folder / RECORD)
    except (OSError, ValueError, RecursionError, InputError):
        return None


def replaceable_by_batch(folder: Path, inputs: Iterable[Path] = ()) -> Replaceable:
    """What a batch may replace in the folder of a result: what fits have written there, and its own note on them."""
    fits = replaceable_by_fit(folder, inputs)
    return replace(fits, own={**fits.own, RECORD: None}) if fits.own else fits


def earlier(folder: Path, scene: Path, key: str) -> tuple[Fitted, Result] | None:
    """The result in that folder; None where it is not whole, or of other options, code, or input files."""
    record = read_record(folder)
    if record is None or record.key != key:
        return None
    try:
        if any(sha256_of(folder / name) != digest for name, digest in record.files.items()):
            return None
        result = read_result(folder / "result.json")
        same = _contents(result.inputs, Path(record.scene)) == _contents(_inputs_now(scene), scene)
    except InputError:  # a file of the result or of the scene is gone, or wrong by now
        return None
    return (record, result) if same else None


def _contents(inputs: Sequence[InputFile], scene: Path) -> set[tuple[str, str]]:
    """Which file holds what; by paths from the scene's folder, so that all may have moved together."""
    return {(os.path.relpath(each.path, scene.parent), each.sha256) for each in inputs}


def _inputs_now(scene_file: Path) -> tuple[InputFile, ...]:
    from fit_material.fitter.observations.scene_data import input_files
    from fit_material.renderer.scene.scene_file import read_scene

    return input_files(read_scene(scene_file), scene_file)
