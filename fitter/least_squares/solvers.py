"""Solvers behind one interface: from a residual function and a start to the least sum of squares."""

from __future__ import annotations

import functools
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.least_squares import jacobian as derivative

if TYPE_CHECKING:
    from fit_material.fitter.least_squares.jax_bridge import Bridge

Residual = Callable[[Tensor], Tensor]
Status = Literal["converged", "stopped"]

PRECISE, ROUGH = 1e-6, 1e-2  # tolerances: of a result, and of a start for a better problem
UNSEEN = 0.1  # half a squared distance to the minimum, in standard errors of the parameters: 0.3 of one
ZERO_RESIDUAL = 1e-9  # share of the first cost that counts as none where a perfect fit exists
RANK_CUT = 1e-12  # singular values below this share of the largest are rounding
ROWS, COLUMNS = (4608, 12288), 8  # problems are padded to the first, the search's pixels and prior, or to multiples
STILL = 5  # steps in a row below the tolerance end Adam
WRITTEN_BY_JAX = {"TF_CPP_MIN_LOG_LEVEL": "1", "TPU_SKIP_MDS_QUERY": "1"}
"""What JAX's import adds to the environment. Added by a thread of its own, it ends the process now and then: the table
moves while the C library reads it for another thread."""

MAX_STEPS = {"lm": 64, "adam": 2000, "lbfgs": 200}


@dataclass(frozen=True)
class Solution:
    """Where a solver ended.

    Attributes:
        x: the free vector, float64, finite.
        cost: half the sum of squared residuals there.
        status: "converged" where a Gauss–Newton step would gain nothing more, else "stopped".
        steps: accepted and refused steps together.
        seconds: wall time.
    """

    x: Float[Tensor, " x"]
    cost: float
    status: Status
    steps: int
    seconds: float


class Solver(Protocol):
    """A least-squares method.

    Args:
        residual: from a free vector to residuals, float64, differentiable by torch.
        start: a free vector.
        tolerance: relative movement below which the method stops, and the share of the cost that a further step may
            still promise in a converged one.
        steps: the most to take; None for `MAX_STEPS`.
    """

    def __call__(
        self, residual: Residual, start: Tensor, tolerance: float = PRECISE, *, steps: int | None = None
    ) -> Solution: ...


def levenberg_marquardt(
    residual: Residual, start: Float[Tensor, " x"], tolerance: float = PRECISE, *, steps: int | None = None
) -> Solution:
    """Optimistix's Levenberg–Marquardt: damped Gauss–Newton by QR of the Jacobian, in float64."""
    begun = time.perf_counter()
    compiling().result()
    return _optimistix(residual, start, tolerance, begun, steps)


@functools.cache
def compiling() -> Future[Solution]:
    """Levenberg–Marquardt's first run, which loads and compiles it for two seconds, in a thread of its own.

    Whoever knows early that it will be needed begins it; the first solution waits for its end.
    """
    for name, value in WRITTEN_BY_JAX.items():
        os.environ.setdefault(name, value)
    pool = ThreadPoolExecutor(1, "compiling")
    first = pool.submit(_optimistix, lambda x: x, torch.zeros(1, dtype=torch.float64), ROUGH, time.perf_counter())
    pool.shutdown(wait=False)
    return first


def _optimistix(
    residual: Residual, start: Float[Tensor, " x"], tolerance: float, begun: float, steps: int | None = None
) -> Solution:
    """The solution, its seconds counted from `begun`."""
    import jax.numpy as jnp

    unknowns, rows = len(start), _rows(len(residual(start)))
    bridge, run = _compiled(rows, steps or MAX_STEPS["lm"])
    columns = _multiple(COLUMNS, unknowns)
    jacobian = jacobian_of(residual)
    bridge.function = lambda padded: _padded(residual(padded[:unknowns]), rows)
    bridge.jacobian = lambda padded: _padded(_padded(jacobian(padded[:unknowns]), rows).T, columns).T
    value, taken = run(jnp.asarray(_padded(start, columns).numpy()), tolerance)
    x = torch.tensor(value.tolist(), dtype=torch.float64)[:unknowns]  # waits for JAX
    if bridge.raised is not None:
        raise bridge.raised
    return _solution(residual, start, x, int(taken), begun, tolerance)


def _rows(count: int) -> int:
    """To how many rows a problem is padded."""
    few, many = ROWS
    return few if count <= few else _multiple(many, count)


def _multiple(of: int, count: int) -> int:
    """The next multiple."""
    return -(-count // of) * of


def _padded(rows: Float[Tensor, "*q"], size: int) -> Float[Tensor, "*q"]:
    return torch.cat([rows, rows.new_zeros(size - len(rows), *rows.shape[1:])])


def jacobian_of(residual: Residual) -> Residual:
    """Its own `jacobian` where it has one, else by `derivative.jacobian`."""
    return getattr(residual, "jacobian", None) or functools.partial(derivative.jacobian, residual)


@functools.cache
def _compiled(size: int, steps: int) -> tuple[Bridge, Callable[..., tuple[Any, Any]]]:
    """Levenberg–Marquardt of so many steps at most for residuals of one length; compiling takes longer than most fits.

    So problems are padded to a few sizes with zeros, which add nothing to a sum of squares: residuals that are always
    0, and unknowns that move nothing and that damping keeps where they are.
    """
    import jax
    import optimistix as optx

    from fit_material.fitter.least_squares.jax_bridge import Bridge

    bridge = Bridge(lambda x: x, size)
    function = bridge.jax_function()

    def run(start: jax.Array, tolerance: jax.Array) -> tuple[jax.Array, jax.Array]:
        solver = optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance)  # type: ignore[arg-type]
        found = optx.least_squares(lambda y, _: function(y), solver, start, max_steps=steps, throw=False)
        return found.value, found.stats["num_steps"]

    return bridge, jax.jit(run)


def adam(
    residual: Residual, start: Float[Tensor, " x"], tolerance: float = PRECISE, *, steps: int | None = None
) -> Solution:
    """Torch's Adam on half the sum of squares, its rate falling along a cosine to the tolerance."""
    begun, most = time.perf_counter(), steps or MAX_STEPS["adam"]
    x = start.clone().requires_grad_()
    optimiser = torch.optim.Adam([x], lr=0.1)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, most, eta_min=tolerance)
    still = taken = 0
    while taken < most and still < STILL:
        before = x.detach().clone()
        optimiser.zero_grad()
        _half_square(residual(x)).backward()
        optimiser.step()
        schedule.step()
        taken += 1
        still = still + 1 if bool((x.detach() - before).abs().max() < tolerance) else 0
    return _solution(residual, start, x.detach(), taken, begun, tolerance)


def lbfgs(
    residual: Residual, start: Float[Tensor, " x"], tolerance: float = PRECISE, *, steps: int | None = None
) -> Solution:
    """Torch's L-BFGS with strong Wolfe line search on half the sum of squares."""
    begun = time.perf_counter()
    x = start.clone().requires_grad_()
    scale = float(_half_square(residual(start)).detach().clamp_min(1e-300))  # its tolerances are absolute
    optimiser = torch.optim.LBFGS(
        [x],
        max_iter=steps or MAX_STEPS["lbfgs"],
        tolerance_grad=1e-3 * tolerance,
        tolerance_change=1e-6 * tolerance,
        line_search_fn="strong_wolfe",
    )

    def closure() -> Tensor:
        optimiser.zero_grad()
        cost = _half_square(residual(x)) / scale
        cost.backward()
        return cost

    optimiser.step(closure)
    taken = int(optimiser.state[x]["n_iter"])
    return _solution(residual, start, x.detach(), taken, begun, tolerance)


SOLVERS: dict[str, Solver] = {"lm": levenberg_marquardt, "adam": adam, "lbfgs": lbfgs}


def _half_square(residual: Float[Tensor, " r"]) -> Float[Tensor, ""]:
    return 0.5 * (residual**2).sum()


def _solution(residual: Residual, start: Tensor, x: Tensor, steps: int, begun: float, tolerance: float) -> Solution:
    """What a solver found, and whether the residuals themselves call it converged."""
    first, cost = float(_half_square(residual(start))), float(_half_square(residual(x)))
    if not (torch.isfinite(x).all() and math.isfinite(cost)):
        x, cost = start, first
    # Steps are no witness: a wall of NaN or a falling rate shrinks them to nothing before the minimum, and along a
    # valley that the residuals hardly determine they stay long when nothing is left to gain.
    # Condensed residuals are few for their cost; whitened ones have the variance 1 that noise then leaves of each.
    by_chance = UNSEEN * min(1.0, cost / max(1, len(residual(x)) - len(x)))
    worthwhile = max(tolerance * cost, by_chance, ZERO_RESIDUAL * first)
    converged = _removable(residual, x) <= worthwhile
    return Solution(x, cost, "converged" if converged else "stopped", steps, time.perf_counter() - begun)


def _removable(residual: Residual, x: Tensor) -> float:
    """The cost that one more Gauss–Newton step would remove, ½|J J⁺ r|²; infinite where J is not finite."""
    jacobian, r = jacobian_of(residual)(x), residual(x)
    if not (jacobian.isfinite().all() and r.isfinite().all()):
        return math.inf
    span, singular, _ = torch.linalg.svd(jacobian, full_matrices=False)
    span = span[:, singular > singular.max() * RANK_CUT]
    return float(_half_square(span.T @ r))
