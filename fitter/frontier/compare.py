"""From a scene to a folder with the comparison of all rungs: runs, table, plot, page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fit_material.fitter.frontier.errors import require_of_scene, truth_beside
from fit_material.fitter.frontier.pareto import Frontier, frontier_of
from fit_material.fitter.frontier.rungs import Rung
from fit_material.fitter.frontier.runs import Experiment, all_runs
from fit_material.fitter.observations.scene_data import input_files, material_names
from fit_material.fitter.options.progress import Progress
from fit_material.renderer.compute.devices import torch_device
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import replaced_together, write_bytes_atomically, write_text_atomically
from fit_material.renderer.files.replaceable import Replaceable, json_with
from fit_material.renderer.scene.input_paths import input_paths
from fit_material.renderer.scene.scene_file import Scene, read_scene

TITLES = {False: "What accuracy costs in time", True: "What each choice costs and brings"}


@dataclass(frozen=True)
class Question:
    """What is to be compared.

    Attributes:
        scene: scene file.
        rungs: ways to fit it.
        repeats: of each.
        by: the error that counts.
        choices: whether the rungs are single choices around the first.
        type: of materials that the scene leaves open.
        device: where light is integrated.
    """

    scene: Path
    rungs: tuple[Rung, ...]
    repeats: int
    by: str
    choices: bool
    type: str
    device: str

    @property
    def stem(self) -> str:
        """What the files are called."""
        return "choices" if self.choices else "frontier"

    @property
    def names(self) -> tuple[str, ...]:
        """The files themselves."""
        return tuple(f"{self.stem}.{ending}" for ending in ("csv", "png", "html", "json"))

    @property
    def options(self) -> tuple[str, ...]:
        """Of `fit`, for every run."""
        return "--type", self.type, "--device", self.device


def compare(question: Question, out: Path, command: str, progress: Progress) -> Frontier:
    """Run what has not been run, and write STEM.csv, .png, .html and .json.

    Args:
        out: folder; runs are kept in its `runs`, each as soon as it is done.
        command: the command line, for the page.
        progress: called with the fraction of the runs done.

    Raises:
        InputError: device, scene, truth or an option is wrong, the folder cannot be written, or a file in it is not
            frontier's.
    """
    torch_device(question.device)  # before a folder is made
    truth, scene = truth_beside(question.scene), read_scene(question.scene)
    if truth is not None:
        require_of_scene(truth, material_names(scene, question.scene), question.scene)
    inputs = input_files(scene, question.scene)
    allowed = _replaceable(question, out, scene)
    allowed.require(out, question.names)
    experiment = Experiment(question.scene, inputs, question.options, _folder(out))
    runs = all_runs(experiment, question.rungs, question.repeats, progress)
    found = frontier_of(str(question.scene), question.rungs, runs, truth, question.by, question.choices)
    progress("drawing", 0)
    _write(found, out, question, command, allowed)
    return found


def _replaceable(question: Question, out: Path, scene: Scene) -> Replaceable:
    """All that an earlier comparison wrote, which is known by its JSON; never what the scene is read from."""
    inputs = (*input_paths(scene, question.scene), question.scene.with_name("truth.json"))
    summary = f"{question.stem}.json"
    ours = json_with(out / summary, "rows", "frontier", "knee") is not None
    return Replaceable(
        inputs, dict.fromkeys(question.names if ours else ()), f"one of frontier's, beside its {summary}"
    )


def _folder(out: Path) -> Path:
    folder = out / "runs"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("-o", value=out, expected=f"a folder that can be written ({error.strerror})") from error
    return folder


def _write(found: Frontier, out: Path, question: Question, command: str, allowed: Replaceable) -> None:
    from fit_material.fitter.frontier.page import render_frontier
    from fit_material.fitter.frontier.plot import frontier_png
    from fit_material.fitter.frontier.table import csv_text, json_text

    stem, title = question.stem, TITLES[question.choices]
    with replaced_together(out, last=f"{stem}.json", replaceable=allowed) as folder:
        write_text_atomically(folder / f"{stem}.csv", csv_text(found))
        write_bytes_atomically(folder / f"{stem}.png", frontier_png(found))
        write_text_atomically(folder / f"{stem}.html", render_frontier(found, title, command))
        write_text_atomically(folder / f"{stem}.json", json_text(found))
