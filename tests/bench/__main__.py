"""`python -m tests.bench [PART …] [OPTIONS]`: prints Markdown; without names the parts in `USUAL`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from fit_material.fitter.frontier.rungs import LADDER, Rung, named
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.mitsuba.conversion import variant_here
from tests.bench import (
    accuracy,
    agreement,
    batch,
    budget,
    coverage,
    degraded,
    frame,
    grid,
    hard_cases,
    llvm_states,
    loop,
    maps,
    parity,
    plan,
    pose,
    preflight,
    race,
    recovery,
    scaling,
    throughput,
    tolerance,
    types,
)
from tests.bench.fits import How
from tests.bench.grid import Selection
from tests.bench.photographs import ALPHAS, ENVIRONMENTS, METALS, SHAPES
from tests.bench.setting import header
from tests.support.paths import ROOT, SHARED

USUAL = ("agreement", "recovery", "types", "loop", "parity", "frame")

Parts = dict[str, tuple[str, Callable[[str], Iterator[str]]]]


def main() -> None:
    """Run the parts that are named."""
    asked = _arguments()
    if not SHARED.is_dir():
        sys.exit(f"bench: needs {SHARED}")
    os.environ.setdefault(frame.THREADS, "1")  # llvmpipe reads it once, when the first part makes a context
    variant = variant_here()
    print(header(), flush=True)
    for name in asked.parts or USUAL:
        title, rows = parts(asked)[name]
        print(f"## {title}\n", flush=True)
        for row in rows(variant):
            print(row, flush=True)
        print(flush=True)


def parts(asked: argparse.Namespace) -> Parts:
    """All parts by name: a title, and a function from Mitsuba's variant to lines."""
    whole = _selection(asked, grid.METALS, grid.ALPHAS)
    fewer = _selection(asked, METALS, ALPHAS)
    repeats = asked.repeats
    return {
        "agreement": ("Agreement with Mitsuba", agreement.rows),
        "recovery": ("Recovery and cost of the fit command", recovery.command_rows),
        "recovery-grid": ("Recovery: metals, roughnesses, environments", partial(grid.rows, selection=whole)),
        "recovery-noise": ("Recovery, noise added", partial(grid.rows, selection=whole, noise=grid.NOISE)),
        "recovery-spot": ("Recovery: Spot", partial(grid.spot, selection=whole)),
        "recovery-coverage": ("Coverage of the intervals", partial(coverage.rows, selection=whole)),
        "budget": ("What each error of the model moves", budget.rows),
        "types": ("Recovery and choice of the type", types.rows),
        "degraded": ("Photographs as cameras make them", partial(degraded.rows, how=whole.how, repeats=repeats or 1)),
        "types-4096": ("Recovery and choice of the type, less noise", partial(types.rows, spp=4096)),
        "loop": ("From photographs to the viewer's picture", loop.rows),
        "maps": ("Colour maps", maps.rows),
        "parity": ("GLSL against torch", parity.rows),
        "frame": ("Time of a picture", frame.rows),
        "plan": ("Only the effects that a scene calls for", plan.rows),
        "pose": ("Poses that are off, and mended", partial(pose.rows, shapes=asked.shapes)),
        "preflight": ("Faults that `check` finds", lambda variant: preflight.rows()),
        "race": ("Against Mitsuba's own inverse rendering", race.rows),
        "scaling": (
            "Time and memory",
            partial(scaling.rows, repeats=repeats or scaling.MOST_REPEATS, names=asked.axes),
        ),
        "throughput": (
            "Throughput of the integration",
            partial(throughput.rows, repeats=repeats or throughput.USUAL_REPEATS),
        ),
        "tolerance": (
            "Whether --tolerance keeps its word",
            partial(tolerance.rows, selection=whole, repeats=repeats or tolerance.USUAL_REPEATS),
        ),
        "accuracy": ("What accuracy costs in time", partial(accuracy.rows, extent=_extent(asked), out=asked.out)),
        "batch": (
            "Many small scenes",
            partial(batch.rows, scenes=asked.scenes, repeats=repeats or batch.USUAL_REPEATS),
        ),
        "llvm-states": ("Whatever LLVM a machine has", llvm_states.rows),
        "hard-cases": ("Hard cases", partial(hard_cases.rows, out=asked.out)),
        "real": (
            "Recovery: a sphere and two meshes, 512 samples",
            partial(grid.every_shape, selection=fewer, shapes=asked.shapes, spp=512),
        ),
    }


def _selection(asked: argparse.Namespace, metals: tuple[str, ...], alphas: tuple[float, ...]) -> Selection:
    how = How(asked.type, asked.fidelity)
    repeats = asked.repeats or coverage.MOST
    return Selection(asked.metals or metals, asked.alphas or alphas, asked.environments, how, asked.jobs, repeats)


def _extent(asked: argparse.Namespace) -> accuracy.Extent:
    repeats = asked.repeats or accuracy.USUAL_REPEATS
    return accuracy.Extent(asked.materials, asked.environments, asked.rungs, repeats)


def _rungs(text: str) -> tuple[Rung, ...]:
    try:
        return named(LADDER, text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _arguments() -> argparse.Namespace:
    def listed(text: str) -> tuple[str, ...]:
        return tuple(text.split(","))

    def numbers(text: str) -> tuple[float, ...]:
        return tuple(map(float, listed(text)))

    names = [axis.name for axis in scaling.AXES]
    told = (
        "draws of noise for coverage and degraded; of throughput, of tolerance's whole commands, of accuracy's rungs;"
        f" rounds of batch; runs of scaling, of which 1 is quick and {scaling.MOST_REPEATS} are the most"
    )
    parser = argparse.ArgumentParser("python -m tests.bench", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART")
    parser.add_argument("--metals", type=listed, metavar="Au,Fe", help="symbols of the catalogue")
    parser.add_argument("--alphas", type=numbers, metavar="0.05,0.2")
    parser.add_argument("--environments", type=listed, default=ENVIRONMENTS, metavar=",".join(ENVIRONMENTS))
    parser.add_argument("--shapes", type=listed, default=tuple(SHAPES), metavar=",".join(SHAPES), help="of real")
    parser.add_argument("--type", default="auto", help="what the fits of a grid are told")
    parser.add_argument("--fidelity", default="standard", help="of the fits of a grid")
    parser.add_argument("--jobs", type=int, default=1, help="fits at a time")
    parser.add_argument("--repeats", type=int, help=told)
    parser.add_argument("--axes", type=listed, default=tuple(names), metavar=",".join(names), help="of scaling")
    parser.add_argument("--scenes", type=int, default=batch.SCENES, help="of batch")
    materials = tuple(accuracy.MATERIALS)
    parser.add_argument("--materials", type=listed, default=materials, metavar=",".join(materials), help="of accuracy")
    ladder = ",".join(rung.name for rung in LADDER)
    parser.add_argument("--rungs", type=_rungs, default=LADDER, metavar=ladder, help="of accuracy")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder of accuracy's and hard-cases' pages")
    asked = parser.parse_args()
    unknown = set(asked.parts) - set(parts(asked))
    if strange := set(asked.materials) - set(materials):
        parser.error(f"unknown {', '.join(sorted(strange))}; there are {', '.join(materials)}")
    if unknown:
        parser.error(f"unknown {', '.join(sorted(unknown))}; there are {', '.join(parts(asked))}")
    return asked


if __name__ == "__main__":
    main()
