"""Torch functions seen from JAX: values and derivatives against torch itself and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch

from fit_material.fitter.least_squares.jax_bridge import Bridge
from fit_material.fitter.least_squares.solvers import levenberg_marquardt


def curve(x: torch.Tensor) -> torch.Tensor:
    """Three numbers become four, by functions whose derivatives are known by heart."""
    return torch.stack([x[0] * x[1], torch.exp(x[2]), torch.sin(x[0]) + x[2] ** 3, torch.sqrt(1 + x[1] ** 2)])


def jacobian(x: np.ndarray) -> np.ndarray:
    a, b, c = x
    return np.array([[b, a, 0], [0, 0, np.exp(c)], [np.cos(a), 0, 3 * c**2], [0, b / np.sqrt(1 + b**2), 0]])


POINT = np.array([0.7, -1.3, 0.4])
DIRECTION = np.array([0.2, 0.5, -1.0])


@pytest.fixture(scope="module")
def function():
    return Bridge(curve, 4).jax_function()


@pytest.mark.parametrize("wrap", [lambda f: f, jax.jit], ids=["plain", "jit"])
def test_values_are_torchs(function, wrap):
    found = wrap(function)(jnp.asarray(POINT))
    assert found.dtype == jnp.float64
    np.testing.assert_array_equal(found, curve(torch.tensor(POINT)))


def test_jvp_is_the_jacobian_times_the_direction(function):
    value, tangent = jax.jvp(function, (jnp.asarray(POINT),), (jnp.asarray(DIRECTION),))
    np.testing.assert_array_equal(value, curve(torch.tensor(POINT)))
    np.testing.assert_allclose(tangent, jacobian(POINT) @ DIRECTION, rtol=1e-14)
    step = 1e-5
    ends = [np.asarray(function(jnp.asarray(POINT + sign * step * DIRECTION))) for sign in (1, -1)]
    # third derivatives of about 3 times h²/6, and ε/h
    np.testing.assert_allclose(tangent, (ends[0] - ends[1]) / (2 * step), atol=1e-9)


@pytest.mark.parametrize("wrap", [lambda f: f, jax.jit], ids=["plain", "jit"])
def test_jacfwd_is_the_jacobian(function, wrap):
    np.testing.assert_allclose(wrap(jax.jacfwd(function))(jnp.asarray(POINT)), jacobian(POINT), rtol=1e-14)


def test_linearize_maps_over_directions(function):
    _, linear = jax.linearize(function, jnp.asarray(POINT))
    directions = np.random.default_rng(1).normal(size=(5, 3))
    found = jax.vmap(linear)(jnp.asarray(directions))
    np.testing.assert_allclose(found, directions @ jacobian(POINT).T, rtol=1e-13)


def test_values_map_over_points(function):
    points = np.random.default_rng(2).normal(size=(6, 3))
    expected = np.stack([curve(torch.tensor(point)) for point in points])
    np.testing.assert_array_equal(jax.vmap(function)(jnp.asarray(points)), expected)


def test_derivatives_map_over_points(function):
    """Each point has its own Jacobian, also where `vmap` brings several points and directions at once."""
    rng = np.random.default_rng(3)
    points, directions = rng.normal(size=(2, 6, 3))
    each = jax.vmap(lambda x, d: jax.jvp(function, (x,), (d,))[1])(jnp.asarray(points), jnp.asarray(directions))
    expected = np.stack([jacobian(x) @ d for x, d in zip(points, directions, strict=True)])
    np.testing.assert_allclose(each, expected, rtol=1e-13)
    whole = jax.vmap(jax.jacfwd(function))(jnp.asarray(points))
    np.testing.assert_allclose(whole, np.stack([jacobian(x) for x in points]), rtol=1e-13)


def test_what_torch_raises_is_not_swallowed():
    def broken(x: torch.Tensor) -> torch.Tensor:
        if x[0] != 0:
            raise ValueError("no light on this pixel")
        return x - 1  # … and moves on from its start

    with pytest.raises(ValueError, match=r"^no light on this pixel$"):
        levenberg_marquardt(broken, torch.zeros(2, dtype=torch.float64))


def test_an_exchanged_function_is_used_without_compiling_again():
    bridge = Bridge(curve, 4)
    function = jax.jit(jax.jacfwd(bridge.jax_function()))
    np.testing.assert_allclose(function(jnp.asarray(POINT)), jacobian(POINT), rtol=1e-14)
    bridge.function = lambda x: 2 * curve(x)
    np.testing.assert_allclose(function(jnp.asarray(POINT)), 2 * jacobian(POINT), rtol=1e-14)
    assert function._cache_size() == 1


@pytest.mark.parametrize("error", [ZeroDivisionError("ours"), KeyboardInterrupt()])
def test_what_the_function_raises_is_kept_and_not_printed(error, capfd):
    def broken(x):
        raise error

    bridge = Bridge(broken, 3)
    assert np.isnan(bridge.jax_function()(jnp.ones(2))).all()
    assert bridge.raised is error
    bridge.function = lambda x: torch.cat([x, x[:1]])
    assert bridge.raised is None
    np.testing.assert_array_equal(bridge.jax_function()(jnp.ones(2)), np.ones(3))
    printed = capfd.readouterr()
    assert printed == ("", "")
