"""What a command does not use, it does not load: by the modules of its process when it has done its work."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support.paths import ROOT

RUN = """
import json, sys
from pathlib import Path
listed, *sys.argv[1:] = sys.argv[1:]
from fit_material.fitter.commands.app import main
try:
    main()
finally:
    Path(listed).write_text(json.dumps(sorted(sys.modules)))
"""
QUICK = ("--quiet", "--fidelity", "preview")
FEW = (*QUICK, "--pixels", "300", "--samples", "64", "--no-check")

LIBRARIES = {"torch", "numpy", "scipy", "jax", "mitsuba", "drjit", "matplotlib", "kornia", "skimage", "PIL", "trimesh"}
PLOTS = {"matplotlib", "skimage", "jinja2", "PIL"}
SOLVER = {"jax", "optimistix", "equinox", "lineax"}
READERS = {"trimesh", "rawpy", "tifffile", "exifread"}  # of files that the scene has not
TEXTURES = {"fit_material.fitter.textures", "fit_material.fitter.forward.received_light", "scipy.sparse.linalg"}
POSES = {"fit_material.fitter.poses"}
PRIOR = {
    "fit_material.fitter.metal_prior.catalogue_distribution",
    "fit_material.fitter.metal_prior.likelihood",
    "fit_material.fitter.metal_prior.mixture_posterior",
}
PATHS = {"fit_material.renderer.path_tracing", "fit_material.fitter.effects.interreflection", "mitsuba"}
CHECKS = {"fit_material.fitter.input_checks"}
TOLERANCE = {"fit_material.fitter.uncertainty.tolerance"}
PIPELINE = {"fit_material.fitter.pipeline.fit_scene", "fit_material.fitter.fitted", "fit_material.fitter.export"}
REPORT = {"fit_material.fitter.report", "fit_material.fitter.html.templates", *PLOTS}
OTHERS = {
    f"fit_material.{name}"
    for name in ("fitter.batch", "fitter.frontier", "fitter.next_view", "fitter.selftest", "renderer.synthesis")
}
VIEWER = {"fit_material.renderer.opengl", "fit_material.renderer.viewer", "moderngl", "glfw"}
ANYTHING = {f"fit_material.{top}" for top in ("fitter.pipeline", "renderer.scene", "renderer.rays", "shaders")}


class Need(NamedTuple):
    """What a command is run with, what it needs (so that a list that is empty by mistake is found), and what not."""

    arguments: tuple[str, ...]
    needed: set[str]
    needless: set[str]


APP = "fit_material.fitter.commands.app"
NEEDS = {
    "--help": Need(("--help",), {APP, "typer"}, LIBRARIES | ANYTHING),
    "--version": Need(("--version",), {APP, "typer"}, LIBRARIES | ANYTHING),
    "plan": Need(
        ("plan", "SCENE", *QUICK, "--type", "metal"),
        {"fit_material.fitter.effects.planner", "torch"},
        REPORT | TEXTURES | POSES | PRIOR | PATHS | CHECKS | TOLERANCE | PIPELINE | SOLVER | OTHERS | VIEWER | READERS
        # the plan of a ball has no use for scipy, half of whose modules its optimiser alone would load
        | {"scipy", "fit_material.fitter.metal_prior", "fit_material.fitter.uncertainty"},
    ),
    "check": Need(
        ("check", "SCENE", "--quiet"),
        {"fit_material.fitter.input_checks.checks", "torch"},
        REPORT | TEXTURES | POSES | PRIOR | PATHS | TOLERANCE | PIPELINE | SOLVER | OTHERS | VIEWER | READERS
        | {"scipy.optimize", "fit_material.fitter.effects", "fit_material.fitter.uncertainty"},
    ),
    "fit": Need(
        ("fit", "SCENE", "-o", "OUT", *FEW, "--type", "metal"),
        {"fit_material.fitter.report.report", "fit_material.fitter.metal_prior.nearest_metals", "jax", "matplotlib"},
        (TEXTURES | POSES | PRIOR | PATHS | CHECKS | TOLERANCE | OTHERS | VIEWER | READERS)
        - {"scipy.sparse.linalg"},  # scipy.optimize loads it
    ),
    "fit --type matte": Need(
        ("fit", "SCENE", "-o", "OUT", *FEW, "--type", "matte"),
        {"fit_material.fitter.report.report", "matplotlib"},
        TEXTURES | POSES | PRIOR | PATHS | CHECKS | TOLERANCE | OTHERS | VIEWER | READERS
        | {"scipy.optimize", "fit_material.fitter.metal_prior.nearest_metals"},
    ),
}  # fmt: skip


def modules_of(arguments: tuple[str, ...], scene: Path, folder: Path) -> list[str]:
    """What the process of a command that ends well has loaded."""
    places = {"SCENE": str(scene), "OUT": str(folder / "out")}
    command = [sys.executable, "-c", RUN, str(folder / "modules"), *(places.get(each, each) for each in arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "200"})
    assert done.returncode in (0, 1), done.stderr  # 1: found something, or not determined by so few pixels
    return json.loads((folder / "modules").read_text())


def loaded_of(modules: list[str], names: set[str]) -> set[str]:
    """Those of the names that are modules, or packages of such."""
    return {name for name in names if any(f"{module}.".startswith(f"{name}.") for module in modules)}


def test_the_table_names_modules_that_there_are():
    """A module that was moved would never be loaded by its old name."""
    ours = {name for need in NEEDS.values() for name in need.needed | need.needless if name.startswith("fit_material.")}
    places = {name: ROOT / name.removeprefix("fit_material.").replace(".", "/") for name in ours}
    assert not [name for name, place in places.items() if not (place.is_dir() or place.with_suffix(".py").is_file())]


@pytest.mark.parametrize("command", NEEDS)
def test_a_command_loads_what_it_needs_and_nothing_else(command, gold_photographs, tmp_path):
    arguments, needed, needless = NEEDS[command]
    modules = modules_of(arguments, gold_photographs / "scene.toml", tmp_path)
    assert loaded_of(modules, needed) == needed
    assert not loaded_of(modules, needless)
