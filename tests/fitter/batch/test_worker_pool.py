"""The processes that fit a batch: how each death is reported and counted, and how many there are.

Most tests put a few lines in place of what such a process runs: it dies, or answers, as a fit would.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fit_material.fitter.batch.workers import pool, process
from fit_material.fitter.batch.workers.interrupts import interrupts_held
from fit_material.fitter.batch.workers.pool import MAX_RESTARTS, Lost, local_fits
from fit_material.fitter.batch.workers.record import key_of
from fit_material.fitter.batch.workers.worker import Ended, Task, fit_one
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline import fit_scene

CONNECTED = """
import os, pickle, signal, sys
from multiprocessing.connection import Connection
connection = Connection(int(sys.argv[1]))
def say(text): print(text, file=sys.stderr, flush=True)
"""
TASK = "connection.send(None); connection.recv_bytes()\n"  # loaded, and given something to fit


def ended(monkeypatch, child: str, names: str = "a", count: int = 1) -> dict[str, Ended]:
    """Outcomes of tasks, one for each letter, where a process runs those lines."""
    monkeypatch.setattr(process, "SERVE", CONNECTED + child)
    return {each.name.removeprefix("task-"): each for each in local_fits(count, tasks(names))}


def tasks(names: str) -> list[Task]:
    return [Task(f"task-{name}", Path("scene.toml"), FitOptions(), "", Path("/nowhere"), "") for name in names]


@pytest.mark.parametrize(
    ("last", "cause"),
    [
        ("os.kill(os.getpid(), signal.SIGKILL)", "SIGKILL, perhaps out of memory"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "SIGSEGV"),
        ("say('LLVM ERROR: Cannot select'); say(' #0 stack'); os.abort()", "SIGABRT (LLVM ERROR: Cannot select)"),
        ("say('terminate called …'); say('  what():  std::bad_alloc'); os.abort()", "SIGABRT, out of memory"),
        ("say('Traceback'); say('ValueError: \\033[31mred'); os._exit(3)", r"exit code 3 (ValueError: \x1b[31mred)"),
        ("say('x' * 1000); os.abort()", f"SIGABRT ({'x' * 200})"),
        ("signal.signal(34, signal.SIG_DFL); os.kill(os.getpid(), 36)", "signal 36"),
    ],
)
def test_a_scene_whose_process_dies_has_the_signal_in_its_message(monkeypatch, last, cause):
    found = ended(monkeypatch, f"say('of its start'); {TASK}{last}")["a"]
    reason = f"the process that fitted it died each time, of {cause}; tried {MAX_RESTARTS + 1} times"
    assert found == Ended("task-a", "failed", reason, starts=MAX_RESTARTS + 1)


def test_different_deaths_are_all_in_the_message(monkeypatch, tmp_path):
    """The first by SIGSEGV, the second and third by SIGABRT."""
    child = f"""
{TASK}
first = not os.path.exists({str(tmp_path / "second")!r})
open({str(tmp_path / "second")!r}, "w").close()
os.kill(os.getpid(), signal.SIGSEGV if first else signal.SIGABRT)
"""
    reason = "the process that fitted it died each time, of SIGSEGV, then of SIGABRT; tried 3 times"
    assert ended(monkeypatch, child)["a"].reason == reason


ANSWERS = {name: pickle.dumps(Ended(f"task-{name}", "refused", "so")) for name in "abcde"}
ANSWER = f"""
import re  # and not the module of tasks, which would be seconds of imports
answers = {ANSWERS!r}
connection.send(None)
while True:
    name = re.search(rb"task-(.)", connection.recv_bytes())[1].decode()
    say(os.environ.get("SAID", ""))
    if name == "f":
        os.kill(os.getpid(), signal.SIGKILL)
    connection.send_bytes(answers[name])
"""


def test_a_scene_that_kills_costs_the_others_nothing(monkeypatch, capfd):
    found = ended(monkeypatch, ANSWER, names="abfcde", count=2)
    assert {name: each.how for name, each in found.items()} == {**dict.fromkeys("abcde", "refused"), "f": "failed"}
    assert [each.starts for each in found.values() if each.how == "refused"] == [1] * 5
    assert capfd.readouterr() == ("", "")


def test_what_processes_print_is_shown_once_at_the_end(monkeypatch, capfd):
    monkeypatch.setenv("SAID", "no LLVM here")
    found = ended(monkeypatch, ANSWER, names="abcd", count=2)
    assert {each.how for each in found.values()} == {"refused"}
    assert capfd.readouterr() == ("", "no LLVM here\n")


@pytest.mark.parametrize(
    ("child", "cause"), [("os.abort()", "SIGABRT"), ("raise ValueError('x')", "exit code 1 (ValueError: x)")]
)
def test_processes_that_die_before_they_fit_are_not_begun_for_ever(monkeypatch, child, cause):
    with pytest.raises(Lost) as lost:
        ended(monkeypatch, child, names="abcdefgh", count=3)
    assert str(lost.value) == f"the processes that fit cannot start: {cause}"


def test_no_process_at_all(monkeypatch):
    """Where the system begins none, as its limits of processes and of open files have it."""

    def refuse(*arguments, **options):
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(process.subprocess, "Popen", refuse)
    with pytest.raises(Lost) as lost:
        ended(monkeypatch, "")
    assert str(lost.value) == "the processes that fit cannot start: [Errno 11] Resource temporarily unavailable"


def test_no_process_is_left_where_the_caller_stops(monkeypatch, tmp_path):
    monkeypatch.setattr(process, "SERVE", f"{CONNECTED}open(f'{tmp_path}/{{os.getpid()}}', 'w').close()\n{ANSWER}")
    outcomes = local_fits(2, tasks("abcd"))
    next(outcomes)
    begun = [int(each.name) for each in tmp_path.iterdir()]
    assert len(begun) >= 1
    outcomes.close()
    for number in begun:
        with pytest.raises(ProcessLookupError):
            os.kill(number, 0)


@pytest.fixture
def hang_up() -> Iterator[Callable[[int], object]]:
    """Sets what SIGHUP does until the end of a test; the tests themselves may run under `nohup`."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield lambda action: signal.signal(signal.SIGHUP, action)
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("hang_up")
def test_ctrl_c_is_held_from_a_process_first_instruction_on(monkeypatch):
    """It would print a traceback wherever it was; SIGTERM and SIGHUP are let in later."""
    child = "say(sorted(signal.pthread_sigmask(signal.SIG_BLOCK, []))); os.abort()"
    with pytest.raises(Lost) as lost:
        ended(monkeypatch, child)
    held = [signal.SIGHUP, signal.SIGINT, signal.SIGTERM]
    assert str(lost.value) == f"the processes that fit cannot start: SIGABRT ({held})"
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == set()  # here


def test_under_nohup_a_process_ignores_that_the_terminal_is_closed(monkeypatch, hang_up):
    """From its first instruction on, and what starts it does so still."""
    hang_up(signal.SIG_IGN)
    child = "held = sorted(signal.pthread_sigmask(signal.SIG_BLOCK, [])); say((signal.getsignal(1), held)); os.abort()"
    with pytest.raises(Lost) as lost:
        ended(monkeypatch, child)
    expected = (signal.SIG_IGN, [signal.SIGINT, signal.SIGTERM])
    assert str(lost.value) == f"the processes that fit cannot start: SIGABRT ({expected})"
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="blocked signals are looked up in /proc")
@pytest.mark.usefixtures("hang_up")
def test_a_process_that_fits_holds_ctrl_c_alone():
    """As the system's list of its signals has it, once it has loaded what a fit needs."""
    own = process.Process()
    try:
        assert own.take() is None
        status = Path(f"/proc/{own._process.pid}/status").read_text()
    finally:
        own.kill()
        own.wait()
    blocked = next(int(line.split()[1], 16) for line in status.splitlines() if line.startswith("SigBlk:"))
    assert blocked == 1 << (signal.SIGINT - 1)


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda each: each.name)
def test_interrupts_come_after_what_must_not_be_torn(sent):
    """Of several threads too, any of which the system may choose to take the signal."""
    done = threading.Event()
    waiting = threading.Thread(target=done.wait)
    waiting.start()
    steps = []
    before = signal.signal(sent, lambda number, frame: steps.append(signal.Signals(number).name))
    try:
        with interrupts_held():
            os.kill(os.getpid(), sent)
            time.sleep(0.05)
            steps.append("whole")
        assert steps == ["whole", sent.name]
    finally:
        signal.signal(sent, before)
        done.set()
        waiting.join()


def test_a_fit_that_gets_no_thread_is_no_internal_error(monkeypatch, tmp_path):
    """Python's own words, where a limit of memory leaves none for a stack, or one of processes is reached."""

    def refuse(*arguments, **options):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(fit_scene, "fit_scene", refuse)
    folder = tmp_path / "unfinished"
    folder.mkdir()
    task = Task("a", tmp_path / "scene.toml", FitOptions(), key_of(FitOptions()), folder, "")
    reason = "not enough memory, or too many processes, for this fit (can't start new thread)"
    assert fit_one(task, "here") == Ended("a", "failed", reason, worker="here")


# How many


def test_workers_are_as_many_as_scenes_cores_and_memory_serve(monkeypatch):
    monkeypatch.setattr(pool, "cores", lambda: 8)
    monkeypatch.setattr(pool, "memory_limit", lambda: 13 * 2**30)
    assert [pool.usual_workers(scenes, each) for scenes, each in ((100, 1), (3, 1), (100, 2), (100, 16))] == [
        6,
        3,
        4,
        1,
    ]
