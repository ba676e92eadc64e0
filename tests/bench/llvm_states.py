"""The same photographs fitted whatever LLVM a machine has: exit codes, seconds, and how far the numbers differ.

`tools/with_llvm.sh` brings this machine into each state. What a state may move is the integration of light alone:
another compiler, or torch in its place, rounds otherwise, and sums in another order.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from itertools import combinations
from pathlib import Path

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.least_squares.covariance import Covariance, integration_share
from fit_material.fitter.pipeline import fit_materials
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.result.schema import FittedMaterial, read_result
from fit_material.fitter.uncertainty.active_bound import reported
from tests.bench.fits import How
from tests.support.paths import ROOT, SOURCE

STATES = ("none", "15", "19", "broken")
NOT_HERE = 77  # exit code of with_llvm.sh
PROGRAM = (sys.executable, "-m", "fit_material")
PHOTOGRAPHS = {  # options of synth, of three types
    "metal": ("--metal", "Cu", "--alpha", "0.2"),
    "glossy": ("--color", "0.5", "0.1", "0.1", "--reflectance", "0.04", "0.04", "0.04", "--alpha", "0.15"),
    "matte": ("--color", "0.5", "0.3", "0.2"),
}
NUMBERS = ("n", "k", "f0", "alpha", "color", "reflectance")
ROUNDING = 1e-6  # of a value: light without samples, as a matte's, is summed up in float32 and has no other error
WITHIN = 2.0  # standard deviations by integration of a difference, which 95 % may not pass


def rows(variant: str) -> Iterator[str]:
    """Lines of Markdown: each state's commands, then the differences of its numbers to every other's."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind, options in PHOTOGRAPHS.items():
            _run("", *PROGRAM, "synth", *options, "--size", "96", "--spp", "256", "-o", folder / kind, cwd=folder)
        yield "| state | " + " | ".join(_commands(folder, folder)) + " |"
        yield "|---" * (1 + len(_commands(folder, folder))) + "|"
        found = {}
        for state in STATES:
            cells = []
            for arguments in _commands(folder, folder / state).values():
                code, seconds = _run(state, *PROGRAM, *arguments, cwd=folder)
                cells.append("not here" if code == NOT_HERE else f"exit {code}, {seconds:.0f} s")
            yield f"| {state} | {' | '.join(cells)} |"
            if "not here" not in cells:
                found[state] = _fitted(state, folder)
        yield ""
        yield from _differences(found)


def _commands(photographs: Path, out: Path) -> dict[str, tuple[str | Path, ...]]:
    """Arguments by name; the first state's photographs serve all."""
    metal, scenes = photographs / "metal" / "scene.toml", [photographs / kind / "scene.toml" for kind in PHOTOGRAPHS]
    return {
        "demo": ("demo", "-q", "-o", out / "demo"),
        "fit": ("fit", metal, "-q", "-o", out / "fit"),
        "plan": ("plan", metal),
        "selftest": ("selftest", "-q"),
        "batch": ("batch", *scenes, "-q", "-o", out / "batch", "--fidelity", "preview"),
        "frontier": (
            *("frontier", metal, "-q", "-o", out / "frontier", "--rungs", "viewer,preview-128-1500"),
            *("--repeats", "1", "--type", "metal"),
        ),
    }


def _run(state: str, *command: str | Path, cwd: Path) -> tuple[int, float]:
    """Exit code and seconds."""
    begun = time.perf_counter()
    prefix = ("bash", str(ROOT / "tools" / "with_llvm.sh"), state) if state else ()
    environment = {**os.environ, "PYTHONPATH": str(SOURCE)}
    done = subprocess.run([*prefix, *map(str, command)], capture_output=True, cwd=cwd, env=environment, check=False)
    return done.returncode, time.perf_counter() - begun


Number = tuple[float, float]  # a value and its standard deviation by integration


def _fitted(state: str, folder: Path) -> dict[str, Number]:
    """Every fitted number of all photographs."""
    found = {}
    for kind in PHOTOGRAPHS:
        out = folder / state / kind
        code, _ = _run(state, sys.executable, "-m", __name__, folder / kind / "scene.toml", out, kind, cwd=ROOT)
        assert code == 0, f"{kind} was not fitted where LLVM is {state}"
        share = json.loads((out / "share.json").read_text("utf-8"))
        (material,) = read_result(out / "result.json").materials
        found |= {f"{kind}: {name}": number for name, number in _numbers(material, share)}
    return found


def _numbers(material: FittedMaterial, share: float) -> Iterator[tuple[str, Number]]:
    for name in NUMBERS:
        values, errors = (_as_list(getattr(each, name)) for each in (material, material.stderr))
        for channel, (value, error) in enumerate(zip(values, errors, strict=True)):
            if error is not None:
                yield f"{name}[{channel}]", (value, math.sqrt(share) * error)


def _as_list(numbers: object) -> list:
    return [] if numbers is None else list(numbers) if isinstance(numbers, tuple) else [numbers]


def _differences(found: Mapping[str, Mapping[str, Number]]) -> Iterator[str]:
    ratios = {}
    for first, second in combinations(found, 2):
        for name, (value, error) in found[first].items():
            other, its_error = found[second].get(name, (math.inf, 0.0))
            expected = math.hypot(error, its_error, ROUNDING * max(abs(value), abs(other)))
            ratios[first, second, name] = abs(value - other) / expected if expected else 0.0
    held = sum(ratio <= WITHIN for ratio in ratios.values())
    yield f"{held} of {len(ratios)} differences ({held / len(ratios):.1%}) are within {WITHIN:g} standard deviations"
    yield "of the integration."
    for (first, second, name), ratio in sorted(ratios.items(), key=lambda item: -item[1])[:5]:
        yield f"- {name}, {first} against {second}: {ratio:.3g}"


def main(scene: str, out: str, kind: str) -> None:
    """Fit one scene, and write the share of its variance that the integration of light brought."""
    shares = []

    def noted(fit: Fit) -> tuple[Fit, Covariance]:
        shares.append(integration_share(fit.residuals, fit.x))
        return reported(fit)

    fit_materials.reported = noted
    fit_scene(Path(scene), Path(out), How(type=kind).options())
    (Path(out) / "share.json").write_text(json.dumps(shares[-1]))


if __name__ == "__main__":
    main(*sys.argv[1:])
