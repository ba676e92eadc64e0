"""What a batch begins on this machine: nobody reaches it, nobody else's code runs in it, nothing of it stays behind."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from fit_material.fitter.batch.summary import WORDS
from fit_material.fitter.batch.workers import process
from fit_material.renderer.materials.ground_truth import TrueMatte
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from tests.fitter.batch.test_batch import QUICK, run, taken_over, under_way, wait_until
from tests.support.paths import SOURCE

COMMAND = "import sys; from fit_material.fitter.__main__ import program; sys.argv[0] = 'fit-material'; program()"
MARK = "FIT_MATERIAL_TEST"  # in the environment of a batch and of all that it begins
DONE = "fit-material: 0 of 2 scenes are done and kept; the same command goes on with the others"
INTERRUPTED = "fit-material: interrupted; files of earlier results are as they were, and frontier and batch can go on"

pytestmark = pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="processes are looked up in /proc")


@pytest.fixture(scope="module")
def two_scenes(tmp_path_factory) -> Path:
    """Folder of the same matte ball twice."""
    folder = tmp_path_factory.mktemp("scenes")
    options = SynthOptions(TrueMatte((0.5, 0.3, 0.2)), size=32, spp=4096, views=2)
    first = synthesise(options, folder / "first").parent
    shutil.copytree(first, folder / "second")
    return folder


class Running:
    """A batch of two processes, each of which has a mark in its environment that nothing else has."""

    def __init__(self, scenes: Path, folder: Path, libraries: Path | None = None, work: Path | None = None) -> None:
        """The command lies in `folder`; `libraries` come before all others; it works in the folder `work`."""
        self.out, self.mark = folder / "out", uuid.uuid4().hex
        program = folder / "fit-material"
        program.write_text(COMMAND)
        arguments = ["batch", str(scenes), "-o", str(self.out), "--workers", "2", "--type", "matte", *QUICK]
        path = [str(each) for each in (libraries, SOURCE) if each is not None]
        self.process = subprocess.Popen(
            [sys.executable, str(program), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=work or folder,
            env={**os.environ, MARK: self.mark, "PYTHONPATH": os.pathsep.join(path)},
            start_new_session=True,  # Ctrl-C goes to all of a terminal's processes
        )

    def processes(self) -> set[int]:
        """All that live, the batch's own among them."""
        mark = f"{MARK}={self.mark}".encode()
        found = {int(each.name) for each in Path("/proc").iterdir() if each.name.isdigit() and mark in environ(each)}
        return {number for number in found if state(number) not in "ZX"}

    def wait_until(self, true: Callable[[], object]) -> None:
        wait_until(true, self.process)


def environ(process: Path) -> bytes:
    try:
        return (process / "environ").read_bytes()
    except OSError:  # another user's, or it has ended
        return b""


def state(process: int) -> str:
    """A letter; X where there is no such process."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "X"


def listening(process: int) -> list[str]:
    """Lines of the system's tables about sockets of that process to which others can connect or send."""
    own = {f"{inode}" for inode in socket_inodes(process)}
    found = []
    for table in ("tcp", "tcp6", "udp", "udp6", "raw", "raw6", "unix"):
        path = Path(f"/proc/{process}/net/{table}")
        for line in path.read_text().splitlines()[1:] if path.exists() else []:
            cells = line.split()
            if table == "unix":
                accepts, inode = int(cells[3], 16) & 0x10000, cells[6]  # the kernel's SO_ACCEPTCON
            else:
                accepts, inode = not table.startswith("tcp") or cells[3] == "0A", cells[9]  # its TCP_LISTEN
            if accepts and inode in own:
                found.append(line)
    return found


def socket_inodes(process: int) -> set[str]:
    found = set()
    for each in Path(f"/proc/{process}/fd").iterdir():
        try:
            target = os.readlink(each)
        except OSError:
            continue
        if target.startswith("socket:["):
            found.add(target[8:-1])
    return found


@pytest.mark.parametrize(
    ("family", "address"),
    [(socket.AF_INET, ("127.0.0.1", 0)), (socket.AF_INET6, ("::1", 0)), (socket.AF_UNIX, f"\0{uuid.uuid4().hex}")],
    ids=["IPv4", "IPv6", "unix"],
)
def test_a_socket_that_listens_would_be_seen(family, address):
    """The look that the next tests rely on."""
    with socket.socket(family) as own:
        own.bind(address)
        before = listening(os.getpid())
        own.listen()
        assert len(listening(os.getpid())) == len(before) + 1


TRAP = "import os, pathlib; pathlib.Path({folder!r}, f'{{__name__}}-{{os.getpid()}}').touch()\n"


@dataclass(frozen=True)
class Watched:
    """A batch in the middle of two fits.

    Attributes:
        environments: of its processes; one that fits may just have started another for a moment.
        fitting: how many of them are those that fit.
        listening: lines about sockets of theirs.
        imported: notes of modules that lay in its way, until its end.
    """

    environments: list[bytes]
    fitting: int
    listening: list[str]
    imported: list[str]


@pytest.fixture(scope="module")
def watched(two_scenes, tmp_path_factory) -> Watched:
    """Modules that note who imports them lie where the batch works, and in front of all libraries."""
    folder = tmp_path_factory.mktemp("watched")
    work, libraries, imported = (folder / name for name in ("work", "libraries", "imported"))
    for each in (work, libraries, imported):
        each.mkdir()
    for name in ("dask", "distributed"):
        (libraries / f"{name}.py").write_text(TRAP.format(folder=str(imported)))
    for name in ("dask", "fitter", "multiprocessing", "pickle", "signal", "struct", "torch"):
        (work / f"{name}.py").write_text(TRAP.format(folder=str(imported)))
    batch = Running(two_scenes, folder, libraries, work)
    batch.wait_until(lambda: len(under_way(batch.out)) == 2)
    os.killpg(batch.process.pid, signal.SIGSTOP)  # none ends while it is looked at
    processes = batch.processes()
    environments = [environ(Path(f"/proc/{each}")) for each in processes]
    sockets = [line for each in processes for line in listening(each)]
    fitting = sum(map(is_to_fit, processes))
    os.killpg(batch.process.pid, signal.SIGCONT)
    output, errors = batch.process.communicate()
    assert (batch.process.returncode, errors) == (0, ""), output
    return Watched(environments, fitting, sockets, [each.name for each in imported.iterdir()])


def test_nothing_of_a_batch_listens(watched):
    """Neither it nor its two processes, on any port or socket with a name."""
    # a process that one of the two has forked has its command line until it begins another program
    assert 2 <= watched.fitting < len(watched.environments)
    assert watched.listening == []


def test_neither_dask_nor_modules_of_the_working_folder_are_imported(watched):
    assert watched.imported == []


def test_memory_is_given_back_as_the_system_does_it(watched):
    """Dask's workers give back each 64 kB that they free, and ask for them anew: nine times the system's time."""
    assert [each for each in watched.environments if b"MALLOC_TRIM_THRESHOLD_" in each] == []


MOMENTS = {
    "libraries are imported": lambda batch: "libtorch" in maps(batch.process.pid),
    "a process begins": lambda batch: any(map(is_to_fit, batch.processes())),
    "both fit": lambda batch: len(under_way(batch.out)) == 2,
}


def is_to_fit(process: int) -> bool:
    """Whether it is one of those that fit; LLVM is tried in others before."""
    try:
        return b"fit_material.fitter.batch.workers.child" in Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:  # it has ended
        return False


def maps(process: int) -> str:
    return Path(f"/proc/{process}/maps").read_text()


@pytest.mark.parametrize(
    ("moment", "later", "sent"),
    [
        ("libraries are imported", 0.0, signal.SIGINT),
        ("a process begins", 0.0, signal.SIGINT),
        pytest.param("a process begins", 0.1, signal.SIGINT, marks=pytest.mark.slow),
        ("a process begins", 0.5, signal.SIGINT),
        pytest.param("a process begins", 1.0, signal.SIGINT, marks=pytest.mark.slow),
        ("a process begins", 0.2, signal.SIGTERM),
        ("a process begins", 0.0, signal.SIGHUP),
        pytest.param("a process begins", 0.5, signal.SIGHUP, marks=pytest.mark.slow),
        pytest.param("both fit", 0.0, signal.SIGHUP, marks=pytest.mark.slow),
        ("both fit", 0.0, signal.SIGINT),
    ],
)
def test_ctrl_c_is_quiet_and_ends_all_processes(two_scenes, tmp_path, moment, later, sent):
    """Whenever it comes; so are SIGTERM and SIGHUP, of a closed terminal. All processes get it."""
    batch = Running(two_scenes, tmp_path)
    batch.wait_until(lambda: MOMENTS[moment](batch))
    time.sleep(later)
    os.killpg(batch.process.pid, sent)
    output, errors = batch.process.communicate()
    assert (batch.process.returncode, output) == (130, "")
    lines = errors.splitlines()
    assert lines in ([INTERRUPTED], [DONE, INTERRUPTED]), errors
    assert len(lines) == 2 or moment == "libraries are imported"
    assert batch.processes() == set()
    assert list(batch.out.glob(".*")) == []


@pytest.mark.parametrize("moment", [pytest.param("a process begins", marks=pytest.mark.slow), "both fit"])
def test_processes_end_where_the_batch_is_killed(two_scenes, tmp_path, moment):
    """SIGKILL, and what comes to the same: the system's end for want of memory."""
    batch = Running(two_scenes, tmp_path)
    batch.wait_until(lambda: MOMENTS[moment](batch))
    batch.process.kill()
    batch.process.communicate()
    deadline = time.monotonic() + 30
    while batch.processes() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert batch.processes() == set()
    assert taken_over(batch.out) == []


LIMITED = "import resource; resource.setrlimit(resource.RLIMIT_AS, (1_536_000_000, 1_536_000_000))"


@pytest.mark.slow  # fits that are begun three times
def test_too_little_memory_is_one_sentence_for_each_scene(two_scenes, tmp_path, monkeypatch, capfd):
    """And no stack of C++: 1.5 GB of address space for each process leave enough to begin with, too little to fit."""
    monkeypatch.setattr(process, "SERVE", f"{LIMITED}; {process.SERVE}")
    assert run(monkeypatch, "batch", two_scenes, "-o", tmp_path / "out", "--workers", "2", "-q", *QUICK) == 1
    said = capfd.readouterr()
    assert said.err == ""
    states = {each["name"]: each for each in json.loads((tmp_path / "out" / "summary.json").read_text())["scenes"]}
    for name in ("first", "second"):
        status, message = states[name]["status"], states[name]["message"]
        assert status in ("failed", "wrong_input")  # of pictures that are too large for what is left
        assert "memory" in message
        assert f"{name}: {WORDS[status]}: {message}" in said.out.splitlines()
