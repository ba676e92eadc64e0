"""Which LLVM library compiles our kernels, decided before Dr.Jit is imported; Dr.Jit itself takes any of version 15 on.

Every libLLVM that can be found is a candidate, the newest of the tested versions first. One is proved by compiling and
running the instructions of our kernels in a process of its own (`llvm_proof`), where a crash is an answer, and the
verdict is kept. Where none serves, everything goes on without a compiler, several times slower.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import re
import resource
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fit_material.renderer.compute.child_process import run_python
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.errors.printable import printable
from fit_material.renderer.files.atomic import write_text_atomically

LIBRARY = "DRJIT_LIBLLVM_PATH"  # the variable from which Dr.Jit takes its library
SWITCH, NONE = "FIT_MATERIAL_LLVM", "none"  # the variable by which a user, or a parent process, does without
TESTED = range(19, 23)  # of Debian's, 19 and 22 compile our kernels, 15 and 16 end the process, 14 is too old
PACKAGE = "libllvm19"
REMEDY = f"sudo apt-get install {PACKAGE}"
TRACEBACK, REFUSED = 1, 3  # exit codes of a proof: it could not be begun; it was, and failed
PATIENCE = 60  # seconds until a proof, which takes half a second, has to end
PROOF = Path(__file__).with_name("llvm_proof.py")
CRASHES = {signal.SIGABRT, signal.SIGSEGV, signal.SIGILL, signal.SIGBUS, signal.SIGFPE, signal.SIGTRAP}
FOLDERS = (
    "/usr/lib/llvm-*/lib",
    "/usr/lib/*-linux-gnu",
    "/usr/lib64",
    "/usr/lib64/llvm*/lib*",
    "/usr/lib",
    "/usr/local/lib",
    "/usr/local/opt/llvm*/lib",
    "/opt/homebrew/opt/llvm*/lib",
)


@dataclass(frozen=True)
class Verdict:
    """Whether one library serves.

    Attributes:
        library: its path, or the name under which the system's loader finds it.
        usable: whether it compiled our instructions, and they gave the right numbers.
        version: LLVM's, where it is usable.
        reason: why it is refused, where it is.
    """

    library: str
    usable: bool
    version: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Choice:
    """The library in use, if any, and those that were refused before it was found."""

    chosen: Verdict | None
    refused: tuple[Verdict, ...] = ()


@functools.cache
def prepare() -> Choice:
    """Set Dr.Jit's compiler for this process and those that it starts; prints one sentence where none serves.

    It writes to the environment, which is safe only as long as no other thread reads it: call it early.
    """
    requested, unwanted = os.environ.get(LIBRARY), os.environ.get(SWITCH) == NONE
    choice = Choice(None) if unwanted else choose(requested, candidates())
    os.environ[LIBRARY] = choice.chosen.library if choice.chosen else os.devnull
    if not unwanted:
        for sentence in [*_misspelt(), *complaints(choice, requested)]:
            with suppress(OSError):  # standard error is closed, or cannot be written
                print(f"fit-material: {printable(sentence)}", file=sys.stderr, flush=True)
    if choice.chosen is None:
        os.environ[SWITCH] = NONE
    return choice


def _misspelt() -> Iterator[str]:
    """A sentence where the switch has a value that is none of its own."""
    if switch := os.environ.get(SWITCH):
        yield str(InputError(SWITCH, value=switch, expected=f"{NONE}, or no such variable; it is ignored"))


def choose(requested: str | None, found: Iterable[Path]) -> Choice:
    """The first usable library of the one that was requested, if any, and of those that were found, in this order."""
    refused = []
    each_once: dict[str, str] = {}
    for library in [*filter(None, [requested]), *map(str, found)]:
        each_once.setdefault(os.path.realpath(library), library)
    for library in each_once.values():
        verdict = verdict_on(library)
        if verdict.usable:
            return Choice(verdict, tuple(refused))
        refused.append(verdict)
    return Choice(None, tuple(refused))


def complaints(choice: Choice, requested: str | None) -> list[str]:
    """Sentences: that the requested library is refused, and that no library serves."""
    found = []
    for verdict in choice.refused:
        if verdict.library == requested:
            expected = f"an LLVM library that compiles our kernels ({verdict.reason}); it is ignored"
            found.append(str(InputError(LIBRARY, value=requested, expected=expected)))
    if choice.chosen is None:
        others = [f"{each.library}: {each.reason}" for each in choice.refused if each.library != requested]
        seen = (
            f"none of the LLVM libraries here serves ({'; '.join(others)})" if others else "no LLVM library was found"
        )
        found.append(f"{seen}; path tracing and light tables take several times as long without: {REMEDY}")
    return found


def candidates() -> list[Path]:
    """Every LLVM library of this system, each once: the tested versions, newest first, then all others."""
    folders = [folder for pattern in FOLDERS for folder in sorted(Path("/").glob(pattern.lstrip("/")))]
    named = [*os.environ.get("LD_LIBRARY_PATH", "").split(":"), os.environ.get("CONDA_PREFIX", "") + "/lib"]
    folders += [folder for name in named if (folder := Path(name)).is_absolute()]  # never the working folder
    found = [*_known_to_loader(), *(path for folder in folders for path in _libraries(folder))]
    real = {os.path.realpath(path): path for path in reversed(found) if path.is_file()}
    return sorted(real.values(), key=_rank, reverse=True)


def _known_to_loader() -> Iterator[Path]:
    """Libraries in the dynamic loader's cache."""
    with suppress(OSError):
        done = subprocess.run(["/sbin/ldconfig", "-p"], capture_output=True, text=True, errors="replace", check=False)
        yield from (
            Path(found) for found in re.findall(r"^\s*libLLVM\S*\.so\S* .*=> (/.+)$", done.stdout, re.MULTILINE)
        )


def _libraries(folder: Path) -> Iterator[Path]:
    with suppress(OSError):
        yield from (path for path in sorted(folder.glob("libLLVM*")) if re.search(r"\.(so|dylib)\b", path.name))


def major_version(library: Path) -> int:
    """By the name of the file or of a folder above it, as in `libLLVM-15.so.1` and `llvm-16/lib`; 0 for neither."""
    real = os.path.realpath(library)
    for pattern in (r"libLLVM(?:-|\.so\.|\.)(\d+)[^/]*$", r"llvm[-@/](\d+)"):
        for name in (str(library), real):
            if found := re.search(pattern, name):
                return int(found[1])
    return 0


def _rank(library: Path) -> tuple[bool, int]:
    number = major_version(library)
    return number in TESTED, number


def verdict_on(library: str) -> Verdict:
    """The verdict on a library, kept from an earlier process where library, versions and machine are the same."""
    key = _key(library)
    kept = _kept()
    if key in kept:
        return Verdict(**kept[key])
    verdict, lasting = _prove(library)
    if key and lasting:
        _keep({**kept, key: asdict(verdict)})
    return verdict


def _prove(library: str) -> tuple[Verdict, bool]:
    """The verdict by a process of its own, and whether it would be the same next time."""
    try:
        done = run_python(str(PROOF), timeout=PATIENCE, **{LIBRARY: library})
    except (subprocess.TimeoutExpired, OSError) as error:
        return Verdict(library, False, reason=f"could not be proved: {error}"), False
    if done.returncode == 0:
        return Verdict(library, True, version=done.stdout.strip()), True
    lasting = done.returncode == REFUSED or -done.returncode in CRASHES
    return Verdict(library, False, reason=_reason(done, library)), lasting


def _reason(done: subprocess.CompletedProcess[str], library: str) -> str:
    """Why a proof failed, in a phrase: C++ begins with the reason, a traceback ends with it."""
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()] or [f"exit code {done.returncode}"]
    noise = r"^jitc?_\w+\(\): |^LLVM ERROR: |0x[0-9a-f]+[:,]? ?|, shutting down .*|\. .*| ?[.!]+$"
    line = re.sub(noise, "", lines[-1 if done.returncode == TRACEBACK else 0]).strip()
    line = line.removeprefix(f'Unable to load "{library}": {library}: ')
    if -done.returncode in CRASHES:
        return f"ends the process by {signal.Signals(-done.returncode).name}: {line}"
    return line


def _key(library: str) -> str:
    """What a verdict depends on; empty for a library that is no file."""
    try:
        real = os.path.realpath(library, strict=True)
        state = os.stat(real)
        memory, _ = resource.getrlimit(resource.RLIMIT_AS)  # too little of it is not the library's fault
        proof = hashlib.sha256(PROOF.read_bytes()).hexdigest()[:16]
        parts = (library, real, state.st_size, state.st_mtime_ns, version("drjit"), proof, _processor(), memory)
        return " ".join(map(str, parts))
    except OSError:
        return ""


def _processor() -> str:
    """The instruction set: a home folder may be shared by machines of several kinds."""
    flags = b""
    with suppress(OSError), open("/proc/cpuinfo", "rb") as file:
        flags = next((line for line in file if line.startswith((b"flags", b"Features"))), b"")
    return f"{platform.machine()}-{hashlib.sha256(flags).hexdigest()[:16]}"


def _store() -> Path:
    cache = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(cache) if os.path.isabs(cache) else Path.home() / ".cache") / "fit-material" / "llvm.json"


def _kept() -> dict[str, dict[str, Any]]:
    """The verdicts of earlier processes; none where their file is missing or damaged."""
    fields = set(Verdict.__dataclass_fields__)
    try:
        found = json.loads(_store().read_text("utf-8"))
        return {key: each for key, each in found.items() if set(each) == fields}
    except (OSError, RuntimeError, ValueError, TypeError, AttributeError):  # no home, no file, no JSON, or another's
        return {}


def _keep(verdicts: dict[str, dict[str, Any]]) -> None:
    """Keep verdicts, if the user's cache can be written; else they are found anew each time."""
    with suppress(OSError, RuntimeError, InputError):
        store = _store()
        store.parent.mkdir(parents=True, exist_ok=True)
        write_text_atomically(store, json.dumps(verdicts, indent=1))
