"""The `fit-material` command: reads arguments, calls, writes, chooses the exit code. Heavy imports are late."""

from __future__ import annotations

import atexit
import functools
import gc
import io
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Annotated, Any, NoReturn

import typer
from typer.exceptions import TyperException

from fit_material.fitter.command_line.address_space import require_address_space
from fit_material.fitter.command_line.output import Unwritable, complain, flush, open_streams, say
from fit_material.fitter.commands.advise import advise
from fit_material.fitter.commands.batch import batch
from fit_material.fitter.commands.check import check
from fit_material.fitter.commands.doctor import doctor
from fit_material.fitter.commands.export import ListingFormats, export
from fit_material.fitter.commands.fit import DONE, NO_MATERIAL, demo, fit
from fit_material.fitter.commands.frontier import frontier
from fit_material.fitter.commands.plan import plan
from fit_material.fitter.commands.probe import probe
from fit_material.fitter.commands.selftest import selftest
from fit_material.fitter.commands.synth import synth
from fit_material.fitter.commands.view import view
from fit_material.fitter.html.plotting import without_the_users_settings
from fit_material.renderer.backends import dr_jit
from fit_material.renderer.errors.input_error import InputError

WRONG_INPUT, INTERRUPTED = 2, 130  # exit codes, beside those of `fit_command`
SOON = 0.01  # seconds
UNTOUCHED = "interrupted; files of earlier results are as they were, and frontier and batch can go on"

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Recover what an object is made of from photographs: n, k, roughness, with error bars.",
)


def prepared(command: Callable[..., None], *prepare: Callable[[], None]) -> Callable[..., None]:
    """The command, which begins with what its libraries need: before anything is read, and before there are threads."""

    @functools.wraps(command)
    def run(**options: Any) -> None:
        for step in prepare:
            step()
        command(**options)

    return run


app.command()(doctor)
for needing_torch in (view, probe):
    app.command()(prepared(needing_torch, require_address_space))
for needing_dr_jit in (advise, frontier, plan, check, fit, batch, synth, demo, selftest):
    app.command()(prepared(needing_dr_jit, require_address_space, dr_jit.prepare))
app.command(cls=ListingFormats)(export)


def program() -> NoReturn:
    """`main` in a process of its own, which ends with it: to take torch, JAX and Dr.Jit down takes another second."""
    open_streams()
    try:
        main()
    except SystemExit as ended:
        flush()
        with suppress(OSError):  # standard error is closed, or cannot be written
            sys.stderr.flush()
        atexit._run_exitfuncs()
        os._exit(ended.code if isinstance(ended.code, int) else DONE)


def main() -> NoReturn:
    """Run the command line; the user's mistakes end in one sentence and exit code 2, never in a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a locale may have no ± or σ
            stream.reconfigure(errors="backslashreplace")
    without_the_users_settings()
    os.environ["JAX_PLATFORMS"] = "cpu"  # it only drives the solver; a user's may name what is not installed
    pressed = _watch_for_interrupts()
    try:
        code = _run(sys.argv[1:] or ["--help"])
        if code == INTERRUPTED:  # typer's own word for Ctrl-C inside of a command
            raise KeyboardInterrupt
        sys.exit(code or DONE)
    except InputError as error:
        _fail(str(error), WRONG_INPUT)
    except TyperException as error:
        _fail(_usage(error), WRONG_INPUT)
    except Unwritable as error:
        _fail(str(error), NO_MATERIAL)
    except KeyboardInterrupt:
        _fail(UNTOUCHED, INTERRUPTED)
    except Exception as error:
        if pressed.is_set():
            _fail(UNTOUCHED, INTERRUPTED)
        if os.environ.get("FIT_MATERIAL_DEBUG"):
            raise
        reason = " ".join(str(error).split()) or type(error).__name__
        _fail(f"internal error, please report it: {reason} (FIT_MATERIAL_DEBUG=1 shows where)", NO_MATERIAL)


def _watch_for_interrupts() -> threading.Event:
    """An event that Ctrl-C, SIGTERM, SIGHUP set: a library that is being imported may make its own error of them."""
    pressed = threading.Event()

    def note(signum: int, frame: FrameType | None) -> None:
        if _swallows(frame):
            threading.Timer(SOON, os.kill, (os.getpid(), signum)).start()
            return
        again = pressed.is_set()
        pressed.set()
        if not again or signum == signal.SIGINT:  # `timeout` sends SIGTERM twice: the first one's sweeping goes on
            raise KeyboardInterrupt

    with suppress(ValueError):  # signals arrive in the main thread only
        signal.signal(signal.SIGINT, note)
        signal.signal(signal.SIGTERM, note)
        if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # of a terminal that was closed; `nohup` goes on
            signal.signal(signal.SIGHUP, note)
    return pressed


def _swallows(frame: FrameType | None) -> bool:
    """Whether an exception would be printed there and lost: in finalisers, and when garbage is collected."""
    callbacks = {getattr(each, "__code__", None) for each in gc.callbacks}
    while frame is not None:
        if frame.f_code.co_name == "__del__" or frame.f_code in callbacks:
            return True
        frame = frame.f_back
    return False


def _run(arguments: list[str]) -> int:
    """The command's exit code, whether or not somebody reads what it prints."""
    try:
        code = app(arguments, prog_name="fit-material", standalone_mode=False)
    except SystemExit:  # typer's own, where the reader of the help has closed it
        code = DONE
    except OSError:
        flush()  # fails once more where it was the help that could not be written
        raise
    flush()
    return code


def _usage(error: TyperException) -> str:
    """The error in the arguments, in one sentence, and where to read the right ones."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "fit-material"
    message = " ".join(error.format_message().split()).rstrip(".")  # type: ignore[attr-defined] — of click's part
    message = message.replace("Value error, ", "", 1)  # the checker's own words
    return f"{message[:1].lower()}{message[1:]}; `{command} --help` lists what there is"


def _fail(sentence: str, code: int) -> NoReturn:
    complain(sentence)
    sys.exit(code)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        say(f"fit-material {version('fit-material')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass
