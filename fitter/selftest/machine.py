"""Requirements of the program on this machine: each check runs in a process of its own, where a crash is found."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version

from fit_material.fitter.command_line.address_space import require_address_space
from fit_material.renderer.backends import dr_jit, llvm
from fit_material.renderer.compute.child_process import run_python
from fit_material.renderer.compute.memory import GIGABYTE, available_memory
from fit_material.renderer.compute.processors import usable_cores
from fit_material.renderer.errors.input_error import InputError

PYTHON = (3, 11)
MEMORY, DISK = 2 * 2**30, 2**30  # bytes: a fit of the standard fidelity takes 1.3 to 1.7 GB; a result some megabytes
PATIENCE = 120  # seconds until a library has to be imported
REINSTALL = "make install"
OPENGL = """
from fit_material.renderer.opengl.context import offscreen_context
context = offscreen_context()
print(context.info["GL_RENDERER"] + ", OpenGL " + context.info["GL_VERSION"])
"""
TORCH = """
import torch
build = f"CUDA {torch.version.cuda}" if torch.version.cuda else "CPU build"
print(f"{torch.__version__}, {build}, {torch.backends.cpu.get_cpu_capability()}")
"""
OTHERS = """
import jax, optimistix, kornia
from fit_material.renderer.mitsuba.conversion import mitsuba
print(mitsuba("scalar_rgb").__version__)
"""


@dataclass(frozen=True)
class Check:
    """One thing that was looked for.

    Attributes:
        name: what it is.
        ok: whether it is there and serves.
        found: what was found, in words.
        remedy: what mends it; empty where nothing is to be mended.
        needed: whether a fit cannot do without.
    """

    name: str
    ok: bool
    found: str
    remedy: str = ""
    needed: bool = True


def checks() -> Iterator[Check]:
    """All of them, what others depend on first."""
    yield python()
    yield system_library()
    yield imported("torch", TORCH)
    yield imported("Dr.Jit", "import drjit; print(drjit.__version__)")
    yield imported("Mitsuba, JAX", OTHERS)
    yield packages()
    yield compiler()
    yield opengl()
    yield processors()
    yield memory()
    yield disk()


def python() -> Check:
    """The interpreter."""
    ok = sys.version_info >= PYTHON
    remedy = "" if ok else "make install PYTHON=/path/to/python3.11"
    return Check("Python", ok, f"{platform.python_version()}, {sys.executable}", remedy)


def system_library() -> Check:
    """What Dr.Jit's wheel is linked against."""
    try:
        dr_jit.require_system_library()
    except InputError:
        return Check("libatomic", False, "not found", dr_jit.REMEDY)
    return Check("libatomic", True, dr_jit.SYSTEM_LIBRARY)


def imported(name: str, code: str) -> Check:
    """Libraries that can be imported, with the versions that the code prints."""
    ok, found = _run(code)
    return Check(name, ok, found, "" if ok else REINSTALL)


def packages() -> Check:
    """The installed versions against those that this program was made for."""
    try:
        wrong = [each for each in requires("fit-material") or [] if "extra ==" not in each and not _satisfied(each)]
    except PackageNotFoundError:
        wrong = ["fit-material"]
    found = f"not as required: {', '.join(wrong)}" if wrong else "the versions that pyproject.toml names"
    return Check("packages", not wrong, found, REINSTALL if wrong else "")


def _satisfied(requirement: str) -> bool:
    from packaging.requirements import Requirement

    wanted = Requirement(requirement)
    try:
        return (wanted.marker is not None and not wanted.marker.evaluate()) or version(wanted.name) in wanted.specifier
    except PackageNotFoundError:
        return False


def compiler() -> Check:
    """The LLVM that Dr.Jit would take here, and why each other was refused or left."""
    if os.environ.get(llvm.SWITCH) == llvm.NONE:
        return Check("LLVM", False, f"not looked for, by {llvm.SWITCH}={llvm.NONE}", f"unset {llvm.SWITCH}", False)
    if not system_library().ok:
        return Check("LLVM", False, f"not tried without {dr_jit.SYSTEM_LIBRARY}", dr_jit.REMEDY, False)
    requested = os.environ.get(llvm.LIBRARY)
    libraries = dict.fromkeys([*filter(None, [requested]), *map(str, llvm.candidates())])
    verdicts = [llvm.verdict_on(each) for each in libraries]
    usable = [each for each in verdicts if each.usable]
    notes = [f"{each.library} refused: {each.reason}" for each in verdicts if not each.usable]
    if not usable:
        return Check("LLVM", False, "; ".join(notes) or "no library of LLVM", llvm.REMEDY, False)
    chosen, *others = usable
    why = f"named by {llvm.LIBRARY}" if chosen.library == requested else "the newest that compiles our kernels"
    notes = [f"{each.library} would serve as well" for each in others] + notes
    return Check("LLVM", True, "; ".join([f"{chosen.version}, {chosen.library}: {why}", *notes]), needed=False)


def opengl() -> Check:
    """Drawing without a display, which the viewer alone needs."""
    from fit_material.renderer.opengl.context import REMEDY

    ok, found = _run(OPENGL)
    return Check("OpenGL", ok, found, "" if ok else REMEDY, needed=False)


def processors() -> Check:
    """Cores that this process may use."""
    return Check("cores", True, str(usable_cores()))


def memory() -> Check:
    """Memory that this process may take, and how much of it a limit on address space leaves."""
    free = available_memory()
    found = f"{free / GIGABYTE:.1f} GB free"
    try:
        require_address_space()
    except InputError as error:
        return Check("memory", False, f"{found}; {error}", "ulimit -v unlimited")
    remedy = "" if free >= MEMORY else "end other programs: a fit takes up to 1.7 GB"
    return Check("memory", free >= MEMORY, found, remedy)


def disk() -> Check:
    """Space where temporary files go, and in the working folder."""
    try:
        free = {folder: shutil.disk_usage(folder).free for folder in (tempfile.gettempdir(), os.getcwd())}
    except OSError as error:  # no folder for temporary files, or a working folder that is gone
        return Check("disk", False, str(error), "set TMPDIR to a folder that can be written; work in one that exists")
    found = ", ".join(f"{size / GIGABYTE:.1f} GB free in {folder}" for folder, size in free.items())
    ok = min(free.values()) >= DISK
    return Check("disk", ok, found, "" if ok else "make space")


def _run(code: str) -> tuple[bool, str]:
    """Whether the code runs to its end in a process of its own, and the last line that it prints."""
    try:
        done = run_python("-c", code, timeout=PATIENCE)
    except (subprocess.TimeoutExpired, OSError) as error:
        return False, str(error)
    printed = done.stdout if done.returncode == 0 else done.stderr
    last = printed.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
    return done.returncode == 0, last[0].removeprefix("fit_material.renderer.errors.input_error.InputError: ")
