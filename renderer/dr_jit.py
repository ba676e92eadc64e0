"""Dr.Jit enters a process prepared: its compiler chosen by `renderer.llvm`, its system library there, its log silent.

Mitsuba, torch's bridge and our own kernels all import it, some from threads; so a finder in front of Python's own
prepares whichever import comes first.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

from renderer import llvm
from renderer.errors import InputError
from renderer.silence import redirected

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
    if "drjit" not in sys.modules:
        sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """Finds Dr.Jit as Python would, once, and prepares it."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != "drjit":
            return None
        prepare()
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            spec.loader.exec_module = partial(_execute, spec.loader.exec_module)
        return spec


def _execute(execute: Callable[[ModuleType], None], module: ModuleType) -> None:
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
            with suppress(OSError):  # nobody reads it
                os.write(2, b"".join(others))
