"""Twelve scenes fitted by this tree and by another of this project: how far any number of their results differs.

`python -m tests.bench.same_results OTHER_TREE [FOLDER]`; photographs and results stay in FOLDER and serve again.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tests.support.paths import ROOT
from tests.support.textured import ball, pattern, photograph_textured

GLOSSY = ("--reflectance", "0.04", "0.04", "0.04")
SYNTHESISED = {  # options of synth
    "gold": ("--metal", "Au", "--alpha", "0.25"),
    "copper": ("--metal", "Cu", "--alpha", "0.1", "--distribution", "beckmann"),
    "aluminium": ("--metal", "Al", "--alpha", "0.4", "--mesh", "ball.obj"),
    "red plastic": ("--color", "0.5", "0.1", "0.1", *GLOSSY, "--alpha", "0.15"),
    "dark plastic": ("--color", "0.05", "0.05", "0.08", *GLOSSY, "--alpha", "0.3"),
    "clay": ("--color", "0.5", "0.3", "0.2"),
    "chalk": ("--color", "0.8", "0.8", "0.7", "--env", "sunsky"),
    "lamp": ("--metal", "Au", "--alpha", "0.2", "--light", "0.3", "0.8", "0.5", "3", "3", "2.8"),
    "exposure": ("--metal", "Ag", "--alpha", "0.2"),
    "poses": ("--metal", "Cu", "--alpha", "0.2"),
}
FITTED = {  # options of fit beside the common ones
    "poses": ("--refine-pose", "--type", "metal"),
    "texture": ("--maps", "color", "--type", "matte"),
    "exposure": ("--type", "metal"),
}
COMMON = ("--fidelity", "preview", "--quiet")
APART = ("time", "inputs", "outputs", "code", "versions")  # keys of a result that hold no number of the fit


def main(other: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    print("| scene | exit codes | numbers | equal | largest relative difference | … over its stated error | MTL |")
    print("|---|---|---|---|---|---|---|")
    for name, scene in _photographed(folder):
        codes, found = [], []
        for tree, out in ((other, folder / name / "before"), (ROOT, folder / name / "after")):
            codes.append(_fit(tree, scene, out, *FITTED.get(name, ())))
            found.append(json.loads((out / "result.json").read_text("utf-8")))
        print(f"| {name} | {codes[0]}, {codes[1]} | {_compared(*found)} | {_mtl(folder / name)} |", flush=True)


def _photographed(folder: Path) -> Iterator[tuple[str, Path]]:
    mesh = ball(folder / "ball.obj")
    for name, options in SYNTHESISED.items():
        out = folder / name / "photographs"
        if not out.exists():
            common = ("--size", "64", "--spp", "256", "--quiet", "-o", out)
            _run(ROOT, "synth", *(mesh if each == "ball.obj" else each for each in options), *common)
        yield name, _changed(name, out / "scene.toml")
    out = folder / "texture" / "photographs"
    if not out.exists():
        photograph_textured(out, mesh, pattern(64), {"type": "diffuse"})
    yield "texture", out / "scene.toml"
    out = folder / "three materials"
    if not (out / "photographs").exists():
        subprocess.run([sys.executable, str(ROOT / "examples" / "three_materials.py"), str(out)], check=True)
    yield "three materials", next(out.rglob("scene.toml"))


def _changed(name: str, scene: Path) -> Path:
    """The scene file with what `synth` does not write: an exposure to be found, cameras that are off."""
    text = scene.read_text("utf-8")
    if name == "exposure":
        text = text.replace("exposure = 1.0", 'exposure = "fit"')
    if name == "poses":
        text = text.replace("target = [0.0, 0.0, 0.0]", "target = [0.02, 0.01, 0.0]")
    changed = scene.with_name("changed.toml")
    changed.write_text(text, "utf-8")
    return changed


def _run(tree: Path, *arguments: str | Path) -> int:
    package = (tree / "src").is_dir()
    command = [sys.executable, "-m", "fit_material" if package else "fitter.cli", *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": str(tree / "src" if package else tree)}
    return subprocess.run(command, env=environment, cwd=tree, check=False).returncode


def _fit(tree: Path, scene: Path, out: Path, *options: str) -> int:
    return _run(tree, "fit", scene, "-o", out, *COMMON, *options)


Numbers = dict[tuple[str, ...], float]


def _numbers(value: Any, *at: str) -> Iterator[tuple[tuple[str, ...], float]]:
    """Every number of a result, by its path."""
    if isinstance(value, Mapping):
        for key, each in value.items():
            if key not in APART:
                yield from _numbers(each, *at, key)
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from _numbers(each, *at, str(index))
    elif isinstance(value, int | float):
        yield at, float(value)


def _compared(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Cells of the table."""
    one, other = dict(_numbers(before)), dict(_numbers(after))
    if one.keys() != other.keys():
        return f"{len(one)} and {len(other)} | not the same numbers: {sorted(one.keys() ^ other.keys())[:3]} | |"
    relative = {at: abs(one[at] - other[at]) / max(abs(one[at]), abs(other[at]), 1e-300) for at in one}
    stated = {at: abs(one[at] - other[at]) / error for at in one if (error := _error_of(at, one))}
    worst, worse = max(relative, key=relative.__getitem__), max(stated.values(), default=math.nan)
    return (
        f"{len(one)} | {sum(one[at] == other[at] for at in one)} | "
        f"{relative[worst]:.1e} ({'.'.join(worst)}) | {worse:.1e}"
    )


def _error_of(at: tuple[str, ...], numbers: Numbers) -> float:
    """The standard error that the result states of a material's number; 0 where it states none."""
    if at[0] != "materials" or len(at) < 3 or at[2] in ("stderr", "interval95", "determined"):
        return 0.0
    return numbers.get((*at[:2], "stderr", *at[2:]), 0.0)


def _mtl(folder: Path) -> str:
    before, after = (
        {each.name: each.read_text("utf-8") for each in (folder / tree).glob("*.mtl")} for tree in ("before", "after")
    )
    differing = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    return f"differ: {', '.join(differing)}" if differing else "equal"


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2] if len(sys.argv) > 2 else "/tmp/same_results"))
