"""One fit in a process of its own: `python -m tests.bench.measured_fit JSON` prints its seconds and its peak memory."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from tests.support.paths import ROOT

STAGES = ("load", "prepare", "solve", "report", "total", "CPU")
STATUS, REFERENCES = Path("/proc/self/status"), Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Asked:
    """What to fit, and how.

    Attributes:
        scene: its file.
        pixels, samples: in the place of the standard fidelity's.
        limit: bytes that the process may hold.
    """

    scene: str
    pixels: int
    samples: int
    limit: int


@dataclass(frozen=True)
class Measured:
    """What it took.

    Attributes:
        seconds: by stage, as `result.json` has them, and of all threads together.
        peaks: bytes of resident memory by what the fit said that it did; "starting" is all before.
        pixels: that were fitted.
    """

    seconds: Mapping[str, float]
    peaks: Mapping[str, int]
    pixels: int

    @property
    def peak(self) -> int:
        """The most memory that was ever held, in bytes."""
        return max(self.peaks.values())


def measured(asked: Asked) -> Measured | str:
    """The fit in a new process; or the last line of what it said where it failed."""
    command = [sys.executable, "-m", "tests.bench.measured_fit", json.dumps(asdict(asked))]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if run.returncode:
        return (run.stderr.strip().splitlines() or [f"ended by signal {-run.returncode}"])[-1]
    return Measured(**json.loads(run.stdout.splitlines()[-1]))


class Peaks:
    """Peak memory from one change of stage to the next; Linux alone lets a process forget its last peak."""

    def __init__(self) -> None:
        self.found: dict[str, int] = {}
        self._stage = "starting"

    def __call__(self, stage: str, share: float = 0.0) -> None:
        if stage != self._stage:
            self.note()
            self._stage = stage

    def note(self) -> None:
        """Keep the peak of the stage that ends."""
        lines = dict(line.split(":", 1) for line in STATUS.read_text().splitlines())
        peak = int(lines["VmHWM"].split()[0]) * 1024
        self.found[self._stage] = max(peak, self.found.get(self._stage, 0))
        REFERENCES.write_text("5")


def _run(asked: Asked) -> Measured:
    from fit_material.fitter.options.fidelity import preset
    from fit_material.fitter.pipeline.fit_scene import FitOptions, fit_scene

    resource.setrlimit(resource.RLIMIT_DATA, (asked.limit, asked.limit))
    peaks = Peaks()
    fidelity = replace(preset("standard"), pixels=asked.pixels, samples=asked.samples)
    with tempfile.TemporaryDirectory() as folder:
        result = fit_scene(Path(asked.scene), Path(folder), FitOptions(fidelity, type="metal"), peaks)
    peaks.note()
    seconds = result.time.model_dump() | {"CPU": time.process_time()}
    return Measured(seconds, peaks.found, result.model.pixels)


if __name__ == "__main__":
    print(json.dumps(asdict(_run(Asked(**json.loads(sys.argv[1]))))))
