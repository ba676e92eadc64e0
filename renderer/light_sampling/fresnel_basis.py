"""Functions of an angle in which every metal's reflectance is a short sum: what light tables hold moments of.

    F(cos_d) ≈ Σ_b f_b T_b(2x - 1),   x = (1 + s) cos_d / (s + cos_d),   s = `BEND`

A conductor's reflectance has poles where cos_d = -1/(n + ik) or so, close to grazing incidence where the index is
large. Polynomials in cos_d converge slowly beside them: of twelve, aluminium's curve lacks 9e-4, which moved its n by
ten standard errors. The bent variable sends what lies beyond grazing far away, and the same twelve leave 3e-6.
"""

from __future__ import annotations

from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.compute import chebyshev

Reflectance = Callable[[Float[Tensor, "b 1"]], Float[Tensor, "b c"]]

BEND = 0.3  # what leaves the least of the catalogue's worst metal by twelve functions


def position(cos_d: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """2x - 1 in [-1, 1]."""
    return 2 * (1 + BEND) * cos_d / (BEND + cos_d) - 1


def basis(cos_d: Float[Tensor, "..."], degree: int) -> Float[Tensor, "degree ..."]:
    """T_b(2x - 1) of cosines in [0, 1]; the first of them is 1."""
    return chebyshev.polynomials(position(cos_d), degree)


def coefficients(reflectance: Reflectance, degree: int, like: Tensor) -> Float[Tensor, "b c"]:
    """f_b of a curve, in the dtype of `like`; of one channel where F has one."""
    x = ((chebyshev.nodes(degree) + 1) / 2).to(like)
    cos_d = BEND * x / (1 + BEND - x)
    return chebyshev.coefficients(reflectance(cos_d[:, None]))
