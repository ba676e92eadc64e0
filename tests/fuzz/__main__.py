"""`python -m tests.fuzz [--share 0.1] [--seed 0] [KIND …]`: a hundred thousand damaged files, each kind in a process.

A process of its own has a bound on its memory, and shows a crash by how it ends; what crashed it is the last file that
it wrote. Every input is told by kind, seed and number, and is made again by them.
"""

from __future__ import annotations

import argparse
import faulthandler
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from fit_material.renderer.compute.processors import usable_cores
from tests.fuzz.readers import READERS, Failure, fuzzed, prepared

COUNTS = {
    "scene": 25_000,
    "transforms": 20_000,
    "obj": 20_000,
    "mtl": 20_000,
    "sensors": 10_000,
    "result": 5_000,
    "list": 10_000,
    "exr": 10_000,
    "hdr": 4_000,
    "npy": 4_000,
    "png": 4_000,
}
MEMORY = 2 << 30  # bytes beyond what a process has when it has imported everything
HUNG = 120  # seconds for a hundred inputs, after which the process ends itself
AT_ONCE = 100


def main() -> int:
    """Feed every kind; 1 where anything was neither read nor refused."""
    asked = _arguments()
    if asked.child:
        return _child(asked.kinds[0], asked.count, asked.seed)
    kinds = asked.kinds or list(COUNTS)
    with ThreadPoolExecutor(usable_cores()) as pool:
        ended = list(pool.map(lambda kind: _fed(kind, asked.share, asked.seed), kinds))
    bad = sum(code != 0 for _, code in ended)
    print(f"{sum(count for count, _ in ended)} inputs, {bad} kinds with failures")
    return int(bad > 0)


def _fed(kind: str, share: float, seed: int) -> tuple[int, int]:
    """Number of inputs of a kind, and the exit code of the process that read them."""
    count, begun = max(1, round(COUNTS[kind] * share)), time.perf_counter()
    options = ("--child", "--count", str(count), "--seed", str(seed))
    code = subprocess.run([sys.executable, "-m", "tests.fuzz", *options, kind], check=False).returncode
    rate = count / (time.perf_counter() - begun)
    print(f"{kind:11}{count:7} inputs  {rate:6.0f}/s  {f'ended with {code}' if code else ''}", flush=True)
    return count, code


def _child(kind: str, count: int, seed: int) -> int:
    failures: list[Failure] = []
    with tempfile.TemporaryDirectory() as folder:
        tree = prepared(Path(folder))
        failures += fuzzed(kind, 1, seed, tree)  # imports what the reader imports late
        _bound_memory()
        for first in range(0, count, AT_ONCE):
            faulthandler.dump_traceback_later(HUNG, exit=True)
            failures += fuzzed(kind, min(AT_ONCE, count - first), seed, tree, first)
    faulthandler.cancel_dump_traceback_later()
    for each in failures[:20]:
        print(f"{each.kind} {each.number}: {each.what}\n    {each.data[:160]!r}", flush=True)
    return min(len(failures), 1)


def _bound_memory() -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m tests.fuzz", description=__doc__)
    parser.add_argument("kinds", nargs="*", choices=[*READERS, []], metavar="KIND")
    parser.add_argument("--share", type=float, default=1.0, help="of the inputs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
