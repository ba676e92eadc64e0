"""A script, for a process of its own: do the instructions of our kernels, compiled by one LLVM, give the right numbers?

Dr.Jit takes any LLVM of version 15 or newer, and some of those end the whole process ("Cannot select … fminimum").
`renderer.backends.llvm` runs this file with the library in DRJIT_LIBLLVM_PATH. Exit code 0: the library serves, and
its version is printed; 3, or a crash: it does not, and the first line of stderr has the reason; 1: no Dr.Jit can be
imported.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

REFUSED = 3  # exit code
LANES = 61  # no multiple of a vector's width: the last one is masked
ROUNDING = 1e-4  # relative: some of Dr.Jit's float32 functions err by dozens of their last bits, wrong code by more

Expected = Callable[[int], float]


def main() -> None:
    """Compile, run and compare; ends the process."""
    import drjit as dr

    if not dr.has_backend(dr.JitBackend.LLVM):
        sys.exit(REFUSED)  # Dr.Jit has printed why
    names, computed, expected = zip(*(*_arithmetic(), *_control_flow(), *_memory()), strict=True)
    dr.eval(computed)
    for name, values, reference in zip(names, computed, expected, strict=True):
        _compare(name, list(values), [reference(i) for i in range(LANES)])
    print(".".join(map(str, dr.detail.llvm_version())))
    sys.stdout.flush()
    os._exit(0)  # to take the compiler down is no part of the proof


def _compare(name: str, values: Sequence[float], reference: Sequence[float]) -> None:
    for value, right in zip(values, reference, strict=True):
        if not abs(value - right) <= ROUNDING * max(1.0, abs(right)):
            print(f"{name}: computed {value:.9g}, expected {right:.9g}", file=sys.stderr)
            sys.exit(REFUSED)


def _x(i: int) -> float:
    """Arguments on both sides of 0 and of 1."""
    return (i - 30) / 16


def _arithmetic() -> list[tuple[str, Any, Expected]]:
    """Float32 and float64 functions; minimum and maximum are what LLVM 15 cannot compile."""
    import drjit as dr
    from drjit.llvm import Array3f, Float, Float64, Int, UInt, UInt64

    i = dr.arange(UInt, LANES)
    x = (Float(i) - 30) / 16
    y = dr.abs(x) + 0.25
    vector = dr.normalize(Array3f(x, y, 1))
    return [
        ("minimum, maximum", dr.clip(x, -0.5, 0.75), lambda i: min(max(_x(i), -0.5), 0.75)),
        ("fma", dr.fma(x, x, 1), lambda i: _x(i) ** 2 + 1),
        ("rsqrt, rcp", dr.rsqrt(y) + dr.rcp(y), lambda i: _y(i) ** -0.5 + 1 / _y(i)),
        ("sqrt", dr.safe_sqrt(x), lambda i: math.sqrt(max(_x(i), 0))),
        ("exp, log", dr.exp(x) + dr.log(y), lambda i: math.exp(_x(i)) + math.log(_y(i))),
        ("power", dr.power(y, 2.2), lambda i: _y(i) ** 2.2),
        ("sincos, tan", sum(dr.sincos(x)) + dr.tan(x), lambda i: math.sin(_x(i)) + math.cos(_x(i)) + math.tan(_x(i))),
        ("acos", dr.acos(vector.z), lambda i: math.acos(1 / math.hypot(_x(i), _y(i), 1))),
        ("atan2", dr.atan2(x, y), lambda i: math.atan2(_x(i), _y(i))),
        ("floor, ceil, round, trunc", _rounded(x), lambda i: _rounded_by_python(_x(i))),
        ("select, copysign", dr.select(x > 0, y, dr.copysign(y, x)), lambda i: math.copysign(_y(i), _x(i))),
        ("isfinite", dr.select(dr.isfinite(dr.rcp(x)), 1.0, 0.0), lambda i: float(_x(i) != 0)),
        ("float64", Float64(i) / 3 + dr.sqrt(Float64(i)), lambda i: i / 3 + math.sqrt(i)),
        ("integers", Float(Int(i) // -7 + Int(i) % 5), lambda i: -(i // 7) + i % 5),
        ("mul_hi", Float(dr.mul_hi(i << 27, UInt(96))), lambda i: ((i << 27) % 2**32 * 96) >> 32),
        ("bits", Float(dr.popcnt(i) + dr.lzcnt(i) + (i ^ 5)), lambda i: i.bit_count() + 32 - i.bit_length() + (i ^ 5)),
        ("uint64", Float((UInt64(i) * 6364136223846793005) >> 40), _congruential),
    ]


def _y(i: int) -> float:
    return abs(_x(i)) + 0.25


def _rounded(x: Any) -> Any:
    import drjit as dr

    return dr.floor(x) + 8 * dr.ceil(x) + 64 * dr.round(x) + 512 * dr.trunc(x)


def _rounded_by_python(x: float) -> float:
    return math.floor(x) + 8 * math.ceil(x) + 64 * round(x) + 512 * math.trunc(x)


def _congruential(i: int) -> float:
    return float((i * 6364136223846793005 % 2**64) >> 40)


def _control_flow() -> list[tuple[str, Any, Expected]]:
    """A loop that each lane leaves at another time, and calls through a table of functions."""
    import drjit as dr
    from drjit.llvm import Float, UInt

    i = dr.arange(UInt, LANES)
    _, total = dr.while_loop((UInt(0), Float(0)), lambda n, s: n < i, lambda n, s: (n + 1, s + Float(n)), label="loop")
    called = dr.switch(i % 3, [lambda x: x + 1, lambda x: x * 2, lambda x: -x], Float(i))
    return [
        ("loop", total, lambda i: i * (i - 1) / 2),
        ("calls", called, lambda i: (i + 1, 2 * i, -i)[i % 3]),
    ]


def _memory() -> list[tuple[str, Any, Expected]]:
    """Gathers of one and of four numbers, scatters, sums by atomic additions and over blocks."""
    import drjit as dr
    from drjit.llvm import Array4f, Float, UInt

    i = dr.arange(UInt, LANES)
    table = dr.arange(Float, 4 * LANES)
    scattered, counted = dr.zeros(Float, LANES), dr.zeros(Float, LANES)
    dr.scatter(scattered, Float(i), LANES - 1 - i)
    dr.scatter_reduce(dr.ReduceOp.Add, counted, Float(1), i % 10)
    blocks = dr.gather(Float, dr.block_sum(Float(dr.arange(UInt, 8 * LANES)), 8), i)
    return [
        ("gather", dr.gather(Float, table, 3 * i, active=i % 2 == 0), lambda i: 3 * i * (i % 2 == 0)),
        ("packet", dr.sum(dr.gather(Array4f, table, i)), lambda i: 16 * i + 6),
        ("scatter", scattered, lambda i: LANES - 1 - i),
        ("atomic sum", counted, lambda i: len(range(i, LANES, 10)) if i < 10 else 0),
        ("block sum", blocks, lambda i: 64 * i + 28),
    ]


if __name__ == "__main__":
    main()
