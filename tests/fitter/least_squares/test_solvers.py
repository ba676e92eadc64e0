"""Three solvers on problems with known minima."""

import math
import os
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from fit_material.fitter.least_squares.solvers import SOLVERS, WRITTEN_BY_JAX, Residual, levenberg_marquardt


def float64(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def rosenbrock(x: torch.Tensor) -> torch.Tensor:
    return torch.stack([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def powell(x: torch.Tensor) -> torch.Tensor:
    """Its Jacobian is singular at the minimum: convergence is linear, and x stays farther off than the cost."""
    a, b, c, d = x
    return torch.stack([a + 10 * b, math.sqrt(5) * (c - d), (b - 2 * c) ** 2, math.sqrt(10) * (a - d) ** 2])


TIMES = torch.linspace(0, 4, 30, dtype=torch.float64)


def decay(x: torch.Tensor) -> torch.Tensor:
    """An exponential without noise, 3 exp(-0.7 t) + 0.5; the parameters that made it are the minimum."""
    return x[0] * torch.exp(-x[1] * TIMES) + x[2] - (3 * torch.exp(-0.7 * TIMES) + 0.5)


MATRIX = torch.from_numpy(np.random.default_rng(1).normal(size=(40, 5)))
RIGHT_SIDE = torch.from_numpy(np.random.default_rng(2).normal(size=40))


def straight(x: torch.Tensor) -> torch.Tensor:
    return MATRIX @ x - RIGHT_SIDE


LEAST_SQUARES = np.linalg.lstsq(MATRIX.numpy(), RIGHT_SIDE.numpy(), rcond=None)[0]


@dataclass(frozen=True)
class Problem:
    """A residual, a start, the known minimum, and how near to it each solver must come."""

    residual: Residual
    start: list[float]
    minimum: list[float]
    near: dict[str, float]


# lm stops at steps of 1e-6 and converges quadratically. lbfgs stops where the slope of the scaled cost is 1e-9: x is
# off by the root of that over the curvature. Adam's 1000 steps end its schedule while it still walks a narrow valley.
# Towards Powell's singular minimum a Gauss-Newton step halves the distance, damping less: 64 steps end before 1e-6.
PROBLEMS = {
    "rosenbrock": Problem(rosenbrock, [-1.2, 1.0], [1, 1], {"lm": 1e-6, "adam": 0.3, "lbfgs": 1e-3}),
    "powell": Problem(powell, [3.0, -1, 0, 1], [0, 0, 0, 0], {"lm": 0.05, "adam": 0.3, "lbfgs": 0.1}),
    "decay": Problem(decay, [1.0, 1.0, 1.0], [3, 0.7, 0.5], {"lm": 1e-6, "adam": 1e-2, "lbfgs": 1e-4}),
    "straight": Problem(straight, [0.0] * 5, LEAST_SQUARES.tolist(), {"lm": 1e-6, "adam": 1e-5, "lbfgs": 1e-5}),
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", PROBLEMS)
def test_known_minima_are_found(name, solver):
    problem = PROBLEMS[name]
    found = SOLVERS[solver](problem.residual, float64(problem.start))
    error = (found.x - float64(problem.minimum)).abs().max().item()
    assert error < problem.near[solver], found
    assert found.x.dtype == torch.float64
    assert found.cost == pytest.approx(0.5 * (problem.residual(found.x) ** 2).sum().item(), rel=1e-12)
    assert found.cost <= 0.5 * (problem.residual(float64(problem.start)) ** 2).sum()
    assert found.steps > 0
    assert found.seconds > 0
    if (name, solver) not in {("rosenbrock", "adam"), ("powell", "adam"), ("powell", "lm")}:  # cut short, see above
        assert found.status == "converged"


@pytest.mark.parametrize("solver", SOLVERS)
def test_at_the_minimum_nothing_moves(solver):
    found = SOLVERS[solver](decay, float64([3.0, 0.7, 0.5]))
    assert found.cost < 1e-10
    torch.testing.assert_close(found.x, float64([3.0, 0.7, 0.5]), atol=1e-3, rtol=0)


@pytest.mark.parametrize("solver", ["adam", "lbfgs"])
def test_a_rough_tolerance_takes_fewer_steps(solver):
    precise, rough = (SOLVERS[solver](decay, float64([1.0, 1.0, 1.0]), tolerance) for tolerance in (1e-6, 1e-2))
    assert rough.steps < precise.steps


def wall(x: torch.Tensor) -> torch.Tensor:
    """The minimum at x = 2 lies behind x = 1, where the residual is nan."""
    return torch.stack([torch.sqrt(1 - x[0]) * 0 + x[0] - 2, x[1] - 1])


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_step_without_finite_residuals_does_no_harm(solver):
    found = SOLVERS[solver](wall, float64([0.0, 0.0]))
    assert found.x.isfinite().all()
    assert found.x[0] <= 1
    assert found.cost <= 0.5 * (wall(float64([0.0, 0.0])) ** 2).sum()
    # Levenberg-Marquardt may find the least cost on this side of the wall; the others end where they were
    assert found.status == "stopped" or found.x[0] > 1 - 1e-3


def island(x: torch.Tensor) -> torch.Tensor:
    """Finite at the start alone, where the slope leads away."""
    residual = torch.stack([x[0] - 2, x[1] - 1])
    return residual if bool(x.detach().abs().max() < 1e-9) else residual * math.nan


@pytest.mark.parametrize("solver", SOLVERS)
def test_without_any_finite_step_the_solver_stops(solver):
    found = SOLVERS[solver](island, float64([0.0, 0.0]))
    torch.testing.assert_close(found.x, float64([0.0, 0.0]), atol=1e-9, rtol=0)
    assert found.status == "stopped"


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_start_without_finite_residuals_stops(solver):
    found = SOLVERS[solver](wall, float64([1.5, 0.0]))
    assert found.status == "stopped"
    assert found.x.tolist() == [1.5, 0.0]


def test_one_compiled_solver_serves_residuals_of_one_length():
    """Two functions of the same size in turn: the second must not meet the first one's Jacobian."""
    start = float64([0.5, 0.5])
    for target in (1.0, -3.0, 1.0):
        found = levenberg_marquardt(lambda x, target=target: torch.stack([x[0] - target, x[1] + target]), start)
        torch.testing.assert_close(found.x, float64([target, -target]), atol=1e-6, rtol=0)


def test_no_other_thread_adds_to_the_environment():
    """The C library's table of it moves when it grows, and `getenv` of another thread then reads what is freed."""
    code = """
import os, sys, threading
added = []
def hook(event, arguments):
    if event == "os.putenv" and threading.current_thread() is not threading.main_thread():
        added.extend(each for each in arguments[:1] if each not in os.environb)
sys.addaudithook(hook)
from fit_material.fitter.least_squares.solvers import compiling
compiling().result()
assert "jax" in sys.modules
print(added)
"""
    environment = {name: value for name, value in os.environ.items() if name not in WRITTEN_BY_JAX}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert run.stdout.strip() == "[]"
