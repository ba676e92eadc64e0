"""The formulas by which a fit's materials may reflect, under the names that the command line has for them."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.material import MaterialReflectance
from fit_material.shaders.materials.types import Material


def exact_reflectance(material: Material, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p c"]:
    """F of a conductor at n, k, of a dielectric with one index for all channels, or Schlick's of a matte material."""
    return material.exact_reflectance(cosine)


def viewer_reflectance(material: Material, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
    """F as the thesis approximates it."""
    return material.viewer_reflectance(cosine)


def schlick_reflectance(material: Material, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
    """F by Schlick's approximation from F0, of every material."""
    return material.schlick_reflectance(cosine)


REFLECTANCES: dict[str, MaterialReflectance] = {
    "conductor": exact_reflectance,
    "lazanyi": viewer_reflectance,
    "schlick": schlick_reflectance,
}
"""By the words of `Fidelity.reflectance`."""
