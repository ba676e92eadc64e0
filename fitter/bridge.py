"""A torch function as a differentiable JAX function; the one file that imports both."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import torch
from jax import Array
from torch import Tensor

jax.config.update("jax_enable_x64", True)  # least squares squares the condition number; float32 loses it


def jax_function(function: Callable[[Tensor], Tensor], size: int) -> Callable[[Array], Array]:
    """`function` for JAX, with forward derivatives from `torch.func`.

    Args:
        function: from a float64 vector to a float64 vector of length `size`, pure.
        size: length of the result.

    Returns:
        the same function of JAX arrays, differentiable by `jax.jvp` and `jax.linearize`, also under `vmap`.
    """
    jacobian = torch.func.jacfwd(function)
    shape = jax.ShapeDtypeStruct((size,), jnp.float64)

    def value(x: np.ndarray) -> np.ndarray:
        return function(_tensor(x)).detach().numpy()

    def product(x: np.ndarray, direction: np.ndarray) -> np.ndarray:
        # All directions of a batch share one point: `jax.linearize` maps over directions alone.
        point = _tensor(x).reshape(-1, x.shape[-1])[0]
        return (_tensor(direction) @ jacobian(point).T).detach().numpy()

    def tangent(x: Array, direction: Array) -> Array:
        return jax.pure_callback(product, shape, x, direction, vmap_method="broadcast_all")

    differentiable = jax.custom_jvp(lambda x: jax.pure_callback(value, shape, x, vmap_method="sequential"))
    differentiable.defjvp(lambda primals, tangents: (differentiable(*primals), tangent(*primals, *tangents)))
    return differentiable


def _tensor(array: np.ndarray) -> Tensor:
    return torch.from_numpy(np.array(array, dtype=np.float64))
