"""Solvers behind one interface: from a residual function and a start to the least sum of squares."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor

if TYPE_CHECKING:
    from fitter.bridge import Bridge

Residual = Callable[[Tensor], Tensor]
Status = Literal["converged", "stopped"]


@dataclass(frozen=True)
class Solution:
    """Where a solver ended.

    Attributes:
        x: the free vector, float64, finite.
        cost: half the sum of squared residuals there.
        status: "converged", or "stopped" where the step limit came first or no finite step was left.
        steps: accepted and refused steps together.
        seconds: wall time.
    """

    x: Float[Tensor, " x"]
    cost: float
    status: Status
    steps: int
    seconds: float


Solver = Callable[[Residual, Tensor, int], Solution]


def levenberg_marquardt(residual: Residual, start: Float[Tensor, " x"], max_steps: int = 64) -> Solution:
    """Optimistix's Levenberg–Marquardt: damped Gauss–Newton by QR of the Jacobian, in float64."""
    import jax.numpy as jnp

    begun = time.perf_counter()
    bridge, run = _compiled(len(residual(start)), max_steps)
    bridge.function = residual
    value, steps, converged = run(jnp.asarray(start.numpy()))
    x = torch.tensor(value.tolist(), dtype=torch.float64)
    return _solution(residual, start, x, bool(converged), int(steps), begun)


@functools.cache
def _compiled(size: int, max_steps: int) -> tuple[Bridge, Callable[..., tuple[Any, Any, Any]]]:
    """Levenberg–Marquardt for residuals of one length; compiling takes longer than most fits."""
    import jax
    import optimistix as optx

    from fitter.bridge import Bridge

    bridge = Bridge(lambda x: x, size)
    function = bridge.jax_function()
    solver = optx.LevenbergMarquardt(rtol=1e-6, atol=1e-6)

    def run(start: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        found = optx.least_squares(lambda y, _: function(y), solver, start, max_steps=max_steps, throw=False)
        return found.value, found.stats["num_steps"], found.result == optx.RESULTS.successful

    return bridge, jax.jit(run)


def adam(residual: Residual, start: Float[Tensor, " x"], max_steps: int = 1000) -> Solution:
    """Torch's Adam on half the sum of squares, its rate falling along a cosine."""
    begun = time.perf_counter()
    x = start.clone().requires_grad_()
    optimiser = torch.optim.Adam([x], lr=0.1)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, max_steps, eta_min=1e-5)
    previous, still, step = x.detach().clone(), 0, 0
    for step in range(1, max_steps + 1):  # noqa: B007
        optimiser.zero_grad()
        _half_square(residual(x)).backward()
        optimiser.step()
        schedule.step()
        still = still + 1 if bool((x.detach() - previous).abs().max() < 1e-6) else 0
        previous = x.detach().clone()
        if still == 10:
            break
    # At the end of the cosine the rate is 1e-5: the last step is then below any figure that is reported.
    settled = still == 10 or step == max_steps
    return _solution(residual, start, x.detach(), settled, step, begun)


def lbfgs(residual: Residual, start: Float[Tensor, " x"], max_steps: int = 200) -> Solution:
    """Torch's L-BFGS with strong Wolfe line search on half the sum of squares."""
    begun = time.perf_counter()
    x = start.clone().requires_grad_()
    scale = float(_half_square(residual(start)).detach().clamp_min(1e-300))  # its tolerances are absolute
    optimiser = torch.optim.LBFGS(
        [x], max_iter=max_steps, tolerance_grad=1e-9, tolerance_change=1e-12, line_search_fn="strong_wolfe"
    )

    def closure() -> Tensor:
        optimiser.zero_grad()
        cost = _half_square(residual(x)) / scale
        cost.backward()
        return cost

    optimiser.step(closure)
    steps = int(optimiser.state[x]["n_iter"])
    return _solution(residual, start, x.detach(), steps < max_steps, steps, begun)


SOLVERS: dict[str, Solver] = {"lm": levenberg_marquardt, "adam": adam, "lbfgs": lbfgs}


def _half_square(residual: Float[Tensor, " r"]) -> Float[Tensor, ""]:
    return 0.5 * (residual**2).sum()


def _solution(residual: Residual, start: Tensor, x: Tensor, converged: bool, steps: int, begun: float) -> Solution:
    cost = float(_half_square(residual(x)))
    if not (torch.isfinite(x).all() and cost < float("inf")):
        x, cost, converged = start, float(_half_square(residual(start))), False
    return Solution(x, cost, "converged" if converged else "stopped", steps, time.perf_counter() - begun)
