"""The formulas by which a fit's materials may reflect, under the names that the command line has for them."""

from __future__ import annotations

from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor

from fit_material.shaders.materials.types import Glossy, Material, Metal
from fit_material.shaders.optics import fresnel, rough_plastic

MaterialReflectance = Callable[[Material, Float[Tensor, "*p 1"]], Float[Tensor, "*p c"]]
"""F of a material by a cosine, for one or three channels."""


def exact_reflectance(material: Material, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p c"]:
    """F of a conductor at n, k, of a dielectric with one index for all channels, or Schlick's of a matte material."""
    if isinstance(material, Metal):
        return fresnel.conductor(cosine, material.n, material.k)
    if isinstance(material, Glossy):
        return fresnel.dielectric(cosine, rough_plastic.ior(material.reflectance[0]))
    return fresnel.schlick(cosine, material.reflectance)


def viewer_reflectance(material: Material, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
    """F as the thesis approximates it."""
    if isinstance(material, Metal):
        return fresnel.lazanyi(cosine, material.n, material.k)
    return fresnel.schlick(cosine, material.reflectance)


def schlick_reflectance(material: Material, cosine: Float[Tensor, "*p 1"]) -> Float[Tensor, "*p 3"]:
    """F by Schlick's approximation from F0, of every material."""
    return fresnel.schlick(cosine, material.f0 if isinstance(material, Metal) else material.reflectance)


REFLECTANCES: dict[str, MaterialReflectance] = {
    "conductor": exact_reflectance,
    "lazanyi": viewer_reflectance,
    "schlick": schlick_reflectance,
}
"""By the words of `Fidelity.reflectance`."""
