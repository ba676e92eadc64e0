"""Many small scenes by `fit-material batch`: one worker killed in the middle, and two workers against one."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from glob import glob
from itertools import islice, product
from pathlib import Path

from fit_material.fitter.result.schema import read_result
from fit_material.renderer.compute.threads import cores
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.synthesis.synthesise import SynthOptions
from tests.bench.photographs import photographed
from tests.bench.setting import spread
from tests.bench.types import MATERIALS
from tests.support.paths import ROOT

SCENES, USUAL_REPEATS = 100, 5
SIZES, VIEWS, SPP = (32, 40, 48), (1, 2, 3), 256
FIDELITY = "preview"
GOAL = 1.7
ONE, TWO, WHOLE = ("--workers", "1", "--cores", "1"), ("--workers", "2", "--cores", "1"), ("--workers", "1")


@dataclass(frozen=True)
class Batched:
    """A batch that ended.

    Attributes:
        code: its exit code.
        seconds: of the whole command.
        rate: fits an hour from the first that ended to the last, which no start-up slows.
        killed: the scene whose process was killed; "" where none was.
        taken: of each scene, how many times its result was taken over.
        starts: of each scene, how many times it was begun.
        whole: how many results can be read.
    """

    code: int
    seconds: float
    rate: float
    killed: str
    taken: Counter[str]
    starts: dict[str, int]
    whole: int


def rows(variant: str, scenes: int = SCENES, repeats: int = USUAL_REPEATS) -> Iterator[str]:
    """Lines of Markdown: what became of all scenes, then the ratio of throughputs."""
    paths = list(islice(_scenes(variant), scenes))
    yield (
        f"{len(paths)} spheres of {len(MATERIALS)} materials, {VIEWS[0]} to {VIEWS[-1]} photographs of {SIZES[0]}² to"
        f" {SIZES[-1]}², --fidelity {FIDELITY}, --type of each given; {cores()} cores."
    )
    yield ""
    yield from _killed(run(paths, TWO, kill_after=len(paths) // 2), len(paths))
    yield ""
    rounds = [paths[index::repeats] for index in range(repeats)]
    yield from _throughput([[run(part, how) for how in (ONE, TWO, WHOLE)] for part in rounds if len(part) > 3])


def _scenes(variant: str) -> Iterator[tuple[Path, str]]:
    """Scene files and types; materials in turn, so that every part of them has its share of each."""
    for size, views, (name, material) in product(SIZES, VIEWS, MATERIALS.items()):
        options = SynthOptions(material, views=views, size=size, spp=SPP, variant=variant)
        yield photographed(options, f"small-{name.replace(' ', '-')}"), material.type


def _killed(found: Batched, count: int) -> Iterator[str]:
    twice = sum(times > 1 for times in found.taken.values())
    yield "| scenes | results whole | taken over twice | begun twice | exit code | command |"
    yield "|---|---|---|---|---|---|"
    again = sum(times > 1 for times in found.starts.values())
    yield f"| {count} | {found.whole} | {twice} | {again} | {found.code} | {found.seconds:.0f} s |"
    yield ""
    yield f"Killed by SIGKILL while it fitted {found.killed}, which was begun {found.starts.get(found.killed)} times."


def _throughput(rounds: Sequence[Sequence[Batched]]) -> Iterator[str]:
    """Of each way its fits an hour, and over one worker's of the same scenes, run one after the other."""
    yield f"Fits an hour, in {len(rounds)} rounds of other scenes, the ways in turn; median (range). Goal: {GOAL} ×."
    yield ""
    yield "| workers | fits/h, first to last | over one's | fits/h, whole command | over one's |"
    yield "|---|---|---|---|---|"
    for index, name in enumerate(("1 of 1 core", "2 of 1 core", f"1 of {cores()} cores")):
        steady = [each[index].rate for each in rounds]
        whole = [3600 * len(each[index].starts) / each[index].seconds for each in rounds]
        ratios = [each[index].rate / each[0].rate for each in rounds]
        of_all = [each[0].seconds / each[index].seconds for each in rounds]
        yield f"| {name} | {spread(steady)} | {spread(ratios)} | {spread(whole)} | {spread(of_all)} |"


def run(scenes: Sequence[tuple[Path, str]], how: Sequence[str], kill_after: int | None = None) -> Batched:
    """The command in a folder of its own; the process of one fit is killed when so many have ended."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for index, (scene, _) in enumerate(scenes):
            shutil.copytree(scene.parent, folder / f"scene-{index:03}")
        lines = [f"scene-{index:03} --type {kind}" for index, (_, kind) in enumerate(scenes)]
        (folder / "list.txt").write_text("\n".join(lines), encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            "fit_material.fitter.commands.app",
            "batch",
            str(folder / "list.txt"),
            "-o",
            str(folder / "out"),
        ]
        begun = time.perf_counter()
        with subprocess.Popen([*command, "--fidelity", FIDELITY, *how], cwd=ROOT, stdout=subprocess.DEVNULL) as process:
            killed = "" if kill_after is None else _kill_one(process, folder / "out", kill_after)
        seconds = time.perf_counter() - begun
        return _batched(process.returncode, seconds, killed, folder / "out")


def _kill_one(process: subprocess.Popen[bytes], out: Path, after: int) -> str:
    """The scene whose process was killed, one that had just begun."""
    before: set[Path] | None = None
    while process.poll() is None:
        begun = map(Path, glob(str(out / ".unfinished-*/*/*")))  # Path's own fails where a folder goes meanwhile
        under_way = {each for each in begun if not (each / "batch.json").exists()}
        if len(_log(out)) >= after:
            before = under_way if before is None else before
            for each in under_way - before:
                os.kill(int(each.name.partition("-")[0]), signal.SIGKILL)
                return each.parent.name
        time.sleep(0.02)
    return "nothing: the batch had ended"


def _log(out: Path) -> list[dict]:
    log = out / "fits.jsonl"
    return [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()] if log.exists() else []


def _batched(code: int, seconds: float, killed: str, out: Path) -> Batched:
    log = _log(out)
    times = [datetime.fromisoformat(line["time"]).timestamp() for line in log]
    rate = 3600 * (len(log) - 1) / (times[-1] - times[0])
    whole = 0
    for folder in out.glob("scene-*"):
        try:
            whole += bool(read_result(folder / "result.json").materials)
        except InputError:
            continue
    starts = {line["name"]: line["starts"] for line in log}
    return Batched(code, seconds, rate, killed, Counter(line["name"] for line in log), starts, whole)
