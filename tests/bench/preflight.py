"""Whether the preflight finds faults that were put into scenes, and says nothing of scenes that have none."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fit_material.fitter.input_checks.checks import preflight
from fit_material.fitter.input_checks.finding import Finding
from fit_material.fitter.observations.scene_data import load
from fit_material.renderer.compute.threads import one_thread_per_operation
from fit_material.renderer.rays import gbuffer
from tests.bench.preflight_faults import FAULTS, FILES, Scene
from tests.bench.preflight_scenes import COUNT, PreflightScene
from tests.bench.setting import spread

CLEAN = "none"


@dataclass(frozen=True)
class Outcome:
    """What was said of one scene.

    Attributes:
        scene: its number.
        files: how its photographs are written.
        fault: that was put into it; `CLEAN` where none was.
        found: by the preflight.
        seconds: it took, without reading the scene.
    """

    scene: int
    files: str
    fault: str
    found: tuple[Finding, ...]
    seconds: float

    @property
    def right(self) -> bool:
        """Nothing found where nothing is wrong; else the fault, by its kind."""
        kinds = {each.kind for each in self.found}
        return not kinds if self.fault == CLEAN else FAULTS[self.fault][1] in kinds


def outcomes(scenes: Sequence[int], faults: Sequence[str]) -> Iterator[Outcome]:
    """Every scene with each fault, its files in one of the forms in turn; clean ones in all forms."""
    for scene in scenes:
        for fault in faults:
            for files in FILES if fault == CLEAN else [FILES[scene % len(FILES)]]:
                yield outcome(scene, files, fault)


def outcome(scene: int, files: str, fault: str) -> Outcome:
    """What is said of one scene with one fault."""
    made = Scene.read(PreflightScene(scene).folder, files)
    if fault != CLEAN:
        FAULTS[fault][0](made, np.random.default_rng([scene, *fault.encode()]))
    with tempfile.TemporaryDirectory() as folder:
        path = made.write(Path(folder) / "scene")
        loaded = load(path)
        begun = time.perf_counter()
        with one_thread_per_operation():
            found = preflight(loaded, gbuffer.tracer(loaded.shape), path)
        return Outcome(scene, files, fault, tuple(found), time.perf_counter() - begun)


def rows(count: int = COUNT) -> Iterator[str]:
    """A row for each kind of fault, and one for scenes without."""
    every = list(outcomes(range(count), [CLEAN, *FAULTS]))
    yield "| fault | found | other findings alone | seconds |"
    yield "|---|---|---|---|"
    for fault in FAULTS:
        own = [each for each in every if each.fault == fault]
        right, others = sum(each.right for each in own), sum(not each.right and bool(each.found) for each in own)
        yield f"| {fault} | {right} of {len(own)} | {others} | {spread([each.seconds for each in own])} |"
    faulty, clean = ([each for each in every if (each.fault == CLEAN) == want] for want in (False, True))
    right = sum(each.right for each in faulty)
    yield f"| **all faults** | **{right} of {len(faulty)}, {right / len(faulty):.1%}** | | |"
    false = sum(not each.right for each in clean)
    told = f"{false} of {len(clean)} with false alarms, {false / len(clean):.1%}"
    yield f"| none | {told} | | {spread([each.seconds for each in clean])} |"
    yield ""
    for each in every:
        if not each.right:
            said = "; ".join(f"{found.kind}: {found}" for found in each.found) or "nothing"
            yield f"- scene {each.scene} ({each.files}), {each.fault}: {said}"


def main() -> None:
    """Some scenes and faults, by number and by a part of their names, and all that is said of them."""
    scenes = range(COUNT) if sys.argv[1] == "all" else map(int, sys.argv[1].split(","))
    faults = [each for each in (CLEAN, *FAULTS) if any(part in each for part in sys.argv[2:])] or [CLEAN, *FAULTS]
    for each in outcomes(list(scenes), faults):
        said = "; ".join(f"{found.kind}: {found}" for found in each.found)
        print(each.scene, each.files, each.fault, "RIGHT" if each.right else "WRONG", f"{each.seconds:.2f} s", said)


if __name__ == "__main__":
    main()
