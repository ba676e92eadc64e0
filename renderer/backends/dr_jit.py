"""Dr.Jit enters a process prepared: its compiler chosen by `backends.llvm`, its system library there, its log silent.

Mitsuba, torch's bridge and our own kernels all import it, some from threads; so a finder in front of Python's own
prepares whichever import comes first.
"""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import ModuleType

from fit_material.renderer.backends import llvm
from fit_material.renderer.compute.first_import import Execute, at_first_import
from fit_material.renderer.compute.silence import redirected
from fit_material.renderer.errors.input_error import InputError

SYSTEM_LIBRARY = "libatomic.so.1"  # Dr.Jit's wheel is linked against it and does not bring it
REMEDY = "sudo apt-get install libatomic1"


def prepare() -> None:
    """Choose the compiler, as early in a process as possible.

    Raises:
        InputError: the system lacks a library without which Dr.Jit cannot be loaded.
    """
    require_system_library()
    if "drjit" not in sys.modules:
        llvm.prepare()


def require_system_library() -> None:
    """See `prepare`."""
    if sys.platform != "linux":
        return
    try:
        ctypes.CDLL(SYSTEM_LIBRARY)
    except OSError:
        raise InputError(SYSTEM_LIBRARY, expected=f"this library, which Dr.Jit needs: {REMEDY}") from None


def prepare_imports() -> None:
    """From now on, the first import of Dr.Jit is prepared, wherever it comes from."""
    at_first_import("drjit", _execute, prepare)


def _execute(execute: Execute, module: ModuleType) -> None:
    """Import Dr.Jit; its remarks about libraries, which it makes at once, are in words of our own already."""
    with _without_its_remarks():
        execute(module)
    module.set_log_level(module.LogLevel.Error)


@contextmanager
def _without_its_remarks() -> Iterator[None]:
    """Lines that Dr.Jit's C++ code prints on stderr inside the block are dropped; all others are printed at its end."""
    if sys.stderr is not None:  # as it is where it was closed
        sys.stderr.flush()
    with tempfile.TemporaryFile() as caught:
        try:
            with redirected((2,), caught.fileno()):
                yield
        finally:
            caught.seek(0)
            others = [line for line in caught if not line.startswith((b"jit_", b"jitc_"))]
            with suppress(OSError):  # the reader has closed it
                os.write(2, b"".join(others))
