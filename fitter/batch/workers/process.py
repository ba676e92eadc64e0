"""A process of this machine's batch, from outside.

It is reached through a pair of connected sockets that it inherits, so no other program can reach it. The pools of
concurrent.futures and of loky end altogether where one process dies, and processes of `multiprocessing` import modules
of the folder that is worked in before their own; hence `subprocess`, with the connections of `multiprocessing`.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection, Pipe
from typing import IO

from fit_material.fitter.batch.workers.interrupts import interrupts_held
from fit_material.fitter.batch.workers.worker import Ended, Task, is_about_memory
from fit_material.renderer.errors.printable import printable

SERVE = (
    "import sys; sys.path[:] = sys.argv[2:]; "
    "from fit_material.fitter.batch.workers.child import serve; serve(int(sys.argv[1]))"
)
GRACE = 5.0  # seconds for a process that has closed its connection to end
LONGEST = 200  # characters of a dead process's last line


class Process:
    """One process, started.

    Attributes:
        connection: to it; at its end when the process has ended.
        task: that it fits now.
        ready: whether it has loaded what a fit needs.
    """

    def __init__(self) -> None:
        self.task: Task | None = None
        self.ready = False
        self._printed = 0
        with ExitStack() as opened:
            self._output = opened.enter_context(tempfile.TemporaryFile())
            self.connection, theirs = map(opened.enter_context, Pipe())
            self._process = _started(theirs, self._output)
            theirs.close()
            opened.pop_all()

    def give(self, task: Task) -> None:
        """Let it fit that."""
        self.task, self._printed = task, os.fstat(self._output.fileno()).st_size
        with suppress(OSError):  # it has died: its connection is at its end
            self.connection.send(task)

    def take(self) -> Ended | None:
        """How its task ended, now that there is something to hear; None where it has got ready.

        Raises:
            EOFError: it has died.
        """
        try:
            ended = self.connection.recv()
        except OSError as error:  # in the middle of a message
            raise EOFError from error
        self.ready = True
        if ended is not None:
            self.task = None
        return ended

    def exit_status(self) -> str:
        """Signal or exit code of a process that has died, and why, as far as what it printed in its last task shows."""
        try:
            code = self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        lines = self._lines(self._printed)
        if any(map(is_about_memory, lines)):
            return f"{_named(code)}, out of memory"
        line = lines[0 if code < 0 else -1] if lines else ""  # C++ begins with the reason, a traceback ends with it
        return f"{_named(code)} ({line[:LONGEST]})" if line else _named(code)

    def kill(self) -> None:
        """Whatever it does; returns at once."""
        self._process.kill()  # first: it would report a lost connection
        self.connection.close()

    def wait(self) -> list[str]:
        """For the end of a process that was killed; the lines that it printed in all its time."""
        self._process.wait()
        with self._output:
            return self._lines(0)

    def _lines(self, begin: int) -> list[str]:
        """In printable text; `pread` does not move the place where the process writes."""
        size = os.fstat(self._output.fileno()).st_size
        text = os.pread(self._output.fileno(), size - begin, begin).decode(errors="replace")
        lines = (printable(" ".join(line.split())) for line in text.splitlines())
        return [line for line in lines if line]


def _started(connection: Connection, output: IO[bytes]) -> subprocess.Popen[bytes]:
    """A process that inherits its end of a connection, and prints there."""
    command = [sys.executable, "-P", "-c", SERVE, str(connection.fileno()), *sys.path]
    inherited = [connection.fileno()]
    with interrupts_held():
        return subprocess.Popen(
            command, pass_fds=inherited, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
        )


def _named(code: int) -> str:
    """Exit code of `subprocess` in words."""
    if code >= 0:
        return f"exit code {code}"
    if -code == signal.SIGKILL:
        return "SIGKILL, perhaps out of memory"
    try:
        return signal.Signals(-code).name
    except ValueError:  # real-time signals have no names
        return f"signal {-code}"
