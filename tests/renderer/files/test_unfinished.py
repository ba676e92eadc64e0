"""Work under way is hidden under the name of its process: what sweeps, sweeps the dead alone."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fit_material.fitter.batch.batch import alone_in
from fit_material.fitter.export.export import export
from fit_material.renderer.files.atomic import replaced_together, write_bytes_atomically, write_text_atomically
from fit_material.renderer.files.unfinished import SILENT, prefix_here, unfinished_folder
from tests.fitter.result.test_schema import result

COMMAND = [sys.executable, "-m", "fit_material"]
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1"}
HOLD = """
import pathlib, sys, time
from fit_material.renderer.files.atomic import replaced_together
with replaced_together(pathlib.Path(sys.argv[1])) as folder:
    (folder / "half.txt").write_text("half")
    print(folder, flush=True)
    time.sleep(600)
"""

needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")


def holder(out: Path) -> tuple[subprocess.Popen[str], Path]:
    """A process that works in `out`, and where."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(out)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process, Path(process.stdout.readline().strip())


def killed(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.communicate()


def hidden(folder: Path) -> list[Path]:
    return sorted(folder.glob(".unfinished-*"))


def test_a_batch_leaves_a_running_fits_folder_alone_and_sweeps_a_killed_ones(tmp_path):
    process, folder = holder(tmp_path)
    try:
        with alone_in(tmp_path):
            assert (folder / "half.txt").read_text() == "half"
    finally:
        killed(process)
    assert hidden(tmp_path) == [folder]
    with alone_in(tmp_path):
        assert hidden(tmp_path) == []


def test_whatever_writes_into_a_folder_next_sweeps_what_was_killed_there(tmp_path):
    process, folder = holder(tmp_path)
    try:
        export(result(), ["mtl"], tmp_path, "ball")
        assert hidden(tmp_path) == [folder]
    finally:
        killed(process)
    export(result(), ["gltf"], tmp_path, "ball")
    assert hidden(tmp_path) == []


@needs_proc
def test_a_single_file_that_is_written_sweeps_what_was_killed_beside_it(tmp_path):
    """As the viewer's screenshots are; a living process's file stays."""
    living = tmp_path / f"{prefix_here()}abcdefgh"
    living.write_bytes(b"half")
    dead = living.with_name(re.sub(r"-\d+-(?=\d+-abcdefgh$)", f"-{2**22 + 7}-", living.name))
    dead.write_bytes(b"half")
    write_bytes_atomically(tmp_path / "screenshot.png", b"whole")
    assert hidden(tmp_path) == [living]


def test_a_name_says_which_process_began_when():
    """The start is the 22nd field of /proc/PID/stat [proc(5)]; the program's name before it may hold blanks."""
    pid, start = prefix_here().split("-")[-3:-1]
    assert int(pid) == os.getpid()
    if Path("/proc/self/stat").exists():
        assert start == Path("/proc/self/stat").read_text().rpartition(")")[2].split()[22 - 3]


def renamed(folder: Path, position: int, change) -> Path:
    """The folder with one word of its name changed: 1 machine, 2 boot, 3 process, 4 start."""
    words = folder.name.rsplit("-", 5)
    words[position] = change(words[position])
    return folder.rename(folder.with_name("-".join(words)))


@pytest.mark.parametrize(
    ("position", "change", "swept"),
    [
        (3, lambda pid: str(2**22 + 7), True),  # beyond the kernel's largest number
        (4, lambda start: str(int(start) + 1), True),
        (2, lambda boot: "0" * 8, True),
        (1, lambda machine: "0" * 8, False),
    ],
    ids=["ended", "its number is another's by now", "before the machine's last start", "another machine's"],
)
@needs_proc
def test_only_what_is_dead_is_swept(tmp_path, position, change, swept):
    with unfinished_folder(tmp_path) as folder:
        other = renamed(folder, position, change)
        with replaced_together(tmp_path, last="a") as mine:
            (mine / "a").write_text("")
        assert other.exists() is not swept


@pytest.mark.parametrize("name", [".unfinished-abcdefgh", ".unfinished-00000000-00000000-1-1-abcdefgh"])
def test_what_nobody_here_can_ask_for_is_swept_after_a_week_of_silence(tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    (folder / "half.txt").write_text("half")
    for path in (folder, folder / "half.txt"):
        os.utime(path, times=(time.time() - SILENT - 10,) * 2)
    os.utime(folder / "half.txt")  # something happens there
    with alone_in(tmp_path):
        assert folder.exists()
    os.utime(folder / "half.txt", times=(time.time() - SILENT - 10,) * 2)
    with alone_in(tmp_path):
        assert not folder.exists()


def test_folders_that_only_look_alike_stay(tmp_path):
    (tmp_path / ".unfinished-novels").mkdir()
    os.utime(tmp_path / ".unfinished-novels", times=(0, 0))
    with alone_in(tmp_path):
        assert (tmp_path / ".unfinished-novels").exists()


def test_a_name_as_long_as_the_disk_takes_can_be_written(tmp_path):
    path = tmp_path / ("n" * 255)
    write_text_atomically(path, "whole")
    assert path.read_text() == "whole"


@needs_proc
def test_a_closed_terminal_ends_a_fit_as_ctrl_c_does(gold_scene, tmp_path):
    out = tmp_path / "out"
    command = [*COMMAND, "fit", gold_scene, "-o", out, "--fidelity", "reference", "--no-check"]
    with subprocess.Popen(command, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True) as process:
        while not hidden(out):
            assert process.poll() is None
            time.sleep(0.02)
        time.sleep(1)  # past the reading of pictures, into the integration
        process.send_signal(signal.SIGHUP)
        _, said = process.communicate()
    told = "interrupted; files of earlier results are as they were, and frontier and batch can go on"
    assert (process.returncode, said) == (130, f"fit-material: {told}\n")
    assert not out.exists()


def test_nohup_is_obeyed(tmp_path):
    """What was ignored when the program began stays so."""
    code = (
        "import signal; from fit_material.fitter.commands.app import _watch_for_interrupts;"
        "_watch_for_interrupts(); print(signal.getsignal(1).name)"
    )
    command = ["sh", "-c", 'trap "" HUP; exec "$@"', "sh", sys.executable, "-c", code]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "SIG_IGN\n"
