"""What became of every scene of a batch."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from fit_material.fitter.batch.workers.record import Fitted
from fit_material.fitter.result.schema import FittedMaterial, NonNegative, Record, Result

State = Literal["converged", "not_determined", "stopped", "wrong_input", "failed", "pending"]
WORDS: dict[State, str] = {
    "converged": "converged",
    "not_determined": "not determined",
    "stopped": "stopped",
    "wrong_input": "wrong input",
    "failed": "failed",
    "pending": "not fitted yet",
}


class Scene(Record):
    """One scene.

    Attributes:
        name: of its result's folder.
        scene: its file.
        options: of `fit`, as its command line has them.
        status: the result's, or why there is none.
        message: the result's, or what was wrong, a sentence.
        kept: whether an earlier batch had fitted it.
        starts: how many times the fit was started; more than one where a process died.
        worker: that fitted it.
        seconds: that the fit took.
        materials: found, without their correlations.
    """

    name: str
    scene: str
    options: tuple[str, ...]
    status: State = "pending"
    message: str = ""
    kept: bool = False
    starts: int = 0
    worker: str = ""
    seconds: NonNegative | None = None
    materials: tuple[FittedMaterial, ...] = ()

    @property
    def fitted(self) -> bool:
        """Whether it has a result."""
        return self.seconds is not None


class Summary(Record):
    """All scenes of a batch, in the list's order.

    Attributes:
        seconds: that the batch took, until now.
        where: what was fitted by, in words.
        command: the command line.
    """

    format: Literal[1] = 1
    scenes: tuple[Scene, ...]
    seconds: NonNegative
    where: str
    command: str

    @property
    def counts(self) -> dict[State, int]:
        """Scenes of each status that there is, in the order of `WORDS`."""
        found = Counter(scene.status for scene in self.scenes)
        return {state: found[state] for state in WORDS if found[state]}

    @property
    def all_usable(self) -> bool:
        return all(scene.status == "converged" for scene in self.scenes)


def untouched(name: str, scene: Path, options: Sequence[str]) -> Scene:
    """A scene of which nothing is known so far."""
    return Scene(name=name, scene=str(scene), options=tuple(options))


def outcome(scene: Scene, record: Fitted, result: Result, kept: bool) -> Scene:
    """The same scene with its result."""
    return scene.model_copy(
        update={
            "status": result.status,
            "message": result.message,
            "kept": kept,
            "starts": record.starts,
            "worker": record.worker,
            "seconds": result.time.total,
            "materials": tuple(each.model_copy(update={"correlation": None}) for each in result.materials),
        }
    )


def sentence(summary: Summary) -> str:
    """How many scenes ended how, where, and in what time."""
    counts = ", ".join(f"{count} {WORDS[state]}" for state, count in summary.counts.items())
    kept = sum(scene.kept for scene in summary.scenes)
    again = sum(scene.starts > 1 and not scene.kept for scene in summary.scenes)
    more = [f"{kept} of them fitted before"] if kept else []
    more += [f"{again} begun anew after a process had died"] if again else []
    count = len(summary.scenes)
    parts = "; ".join([f"{count} scene{'s' if count != 1 else ''}: {counts}", *more])
    return f"{parts}. {summary.seconds:.0f} s, by {summary.where}."


def json_text(summary: Summary) -> str:
    """All of it, strict JSON."""
    data = {**summary.model_dump(mode="json"), "counts": summary.counts}
    return json.dumps(data, allow_nan=False, ensure_ascii=False, indent=1) + "\n"
