"""Address space that the libraries need to be loaded: below it some abort, from threads of their own."""

from __future__ import annotations

from fit_material.renderer.compute.memory import GIGABYTE, address_limit
from fit_material.renderer.compute.processors import usable_cores
from fit_material.renderer.errors.input_error import InputError

LIBRARIES, OF_CORE = 3.0 * GIGABYTE, 0.3 * GIGABYTE  # of `demo`; every core brings threads with stacks and arenas


def require_address_space() -> None:
    """Refuse a limit that torch, JAX and Dr.Jit do not fit in: what they do then is no exception, but std::bad_alloc.

    Raises:
        InputError: RLIMIT_AS is too low.
    """
    limit, needed = address_limit(), LIBRARIES + OF_CORE * usable_cores()
    if limit is not None and limit < needed:
        expected = f"at least {needed / GIGABYTE:.1f} GB of address space on this machine: `ulimit -v unlimited`"
        raise InputError("ulimit -v", value=f"{limit / GIGABYTE:.1f} GB", expected=expected)
