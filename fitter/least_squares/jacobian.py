"""The derivative of many numbers with respect to a few, by torch's backward passes.

`torch.func.jacfwd` and `jacrev` give the same in about twice the time, and their first call loads torch's compiler,
which takes two seconds.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

Function = Callable[[Tensor], Tensor]


def jacobian(function: Function, x: Float[Tensor, " x"]) -> Float[Tensor, "*r x"]:
    """∂f/∂x at a free vector, for results of any shape."""
    return _derivative(function, x)[1]


def jacobians(function: Function, points: Float[Tensor, "e x"]) -> tuple[Float[Tensor, "e r"], Float[Tensor, "e r x"]]:
    """f(x) and ∂f/∂x at each of several free vectors; `torch.vmap` has to take the function."""
    return _derivative(torch.vmap(lambda x: function(x)), points)  # vmap prints what has no name: whole tensors


def _derivative(function: Function, x: Float[Tensor, "*e x"]) -> tuple[Float[Tensor, "*e r"], Float[Tensor, "*e r x"]]:
    """f(x) and its derivative by the last axis of x, where results of one place e depend on no other.

    uᵀ J is one backward pass, and linear in u: its own derivative with respect to u, along each unknown, is a column
    of J [Griewank & Walther 2008, §3.2].
    """
    with torch.enable_grad():
        at = x.detach().requires_grad_()
        value = function(at)
        if not value.requires_grad:  # it does not depend on x, or there is nothing in it
            return value, value.new_zeros(*value.shape, x.shape[-1])
        along = torch.zeros_like(value, requires_grad=True)
        (pulled,) = torch.autograd.grad(value, at, along, create_graph=True)
        unknowns = torch.eye(x.shape[-1]).to(pulled).reshape(-1, *[1] * (x.dim() - 1), x.shape[-1]).expand(-1, *x.shape)
        (columns,) = torch.autograd.grad(pulled, along, unknowns, is_grads_batched=True)
    return value.detach(), columns.movedim(0, -1)
