"""A torch function as a differentiable JAX function; the one file that imports both."""

from __future__ import annotations

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import optimistix  # noqa: F401 — the solver's own imports: start-up as well, and not its first step
import torch
from jax import Array
from torch import Tensor

from fit_material.fitter.least_squares.jacobian import jacobian

jax.config.update("jax_enable_x64", True)  # least squares squares the condition number; float32 loses it


class Bridge:
    """A place for torch functions of one size, seen from JAX as one function.

    JAX compiles what calls it once; `function` may then be exchanged without compiling again.

    Attributes:
        function: from a float64 vector to a float64 vector of length `size`, pure.
        jacobian: of that vector, float64; `derivative.jacobian` of `function` unless something else is put here
            after it.
        size: length of the result.
        raised: what `function` raised, Ctrl-C included, since it was put here. JAX would print a traceback of its own
            and keep only its text: it gets NaN instead, and whoever called JAX looks here.
    """

    def __init__(self, function: Callable[[Tensor], Tensor], size: int) -> None:
        self.size = size
        self.function = function

    @property
    def function(self) -> Callable[[Tensor], Tensor]:
        return self._function

    @function.setter
    def function(self, function: Callable[[Tensor], Tensor]) -> None:
        self._function = function
        self.jacobian: Callable[[Tensor], Tensor] = functools.partial(jacobian, function)
        self.raised: BaseException | None = None
        self._last: tuple[Tensor, Tensor] | None = None  # a point, and the Jacobian there

    def jax_function(self) -> Callable[[Array], Array]:
        """`function` for JAX, differentiable by `jax.jvp` and `jax.linearize`, also under `vmap`."""
        shape = jax.ShapeDtypeStruct((self.size,), jnp.float64)

        def tangent(x: Array, direction: Array) -> Array:
            return jax.pure_callback(self._product, shape, x, direction, vmap_method="broadcast_all")

        value = jax.custom_jvp(lambda x: jax.pure_callback(self._value, shape, x, vmap_method="sequential"))
        value.defjvp(lambda primals, tangents: (value(*primals), tangent(*primals, *tangents)))
        return value

    def _value(self, x: np.ndarray) -> np.ndarray:
        return self._caught(lambda: self.function(_tensor(x)).detach(), (self.size,))

    def _product(self, x: np.ndarray, direction: np.ndarray) -> np.ndarray:
        return self._caught(lambda: self._products(_tensor(x), _tensor(direction)), (*direction.shape[:-1], self.size))

    def _caught(self, compute: Callable[[], Tensor], shape: tuple[int, ...]) -> np.ndarray:
        """What `compute` returns; NaN, at once, from its first exception on."""
        if self.raised is None:
            try:
                return compute().numpy()
            except BaseException as error:
                self.raised = error
        return np.full(shape, np.nan)

    def _products(self, x: Tensor, directions: Tensor) -> Tensor:
        points = x.reshape(-1, x.shape[-1])
        if torch.equal(points, points[:1].expand_as(points)):  # `jax.linearize` maps over directions alone
            return directions @ self._jacobian_at(points[0]).T
        pairs = zip(points, directions.reshape(-1, x.shape[-1]), strict=True)
        products = torch.stack([self._jacobian_at(point) @ along for point, along in pairs])
        return products.reshape(*directions.shape[:-1], self.size)

    def _jacobian_at(self, point: Tensor) -> Tensor:
        # A Levenberg–Marquardt step evaluates one point twice: for the slope, and for the matrix.
        if self._last is None or not torch.equal(point, self._last[0]):
            self._last = point, self.jacobian(point).detach()
        return self._last[1]


def _tensor(array: np.ndarray) -> Tensor:
    return torch.from_numpy(np.array(array, dtype=np.float64))
