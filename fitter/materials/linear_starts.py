"""Where a search begins: the best of a table's own roughnesses, for a material of which nothing else is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.renderer.light_tables import light_table
from fit_material.shaders.materials.types import Glossy, Material, Matte, Metal, made_of, material_type
from fit_material.shaders.optics import fresnel

PLASTIC = 0.04  # the reflectance of most dielectrics, of index 1.5

Start = Callable[[PixelModel, Float[Tensor, "p 3"], Float[Tensor, "p 3"]], Material]


def metal(model: PixelModel, photograph: Float[Tensor, "p 3"], weight: Float[Tensor, "p 3"]) -> Metal:
    """A metal of flat reflectance, whose F0 is then a linear fit.

        F0 = Σ w² m y / Σ w² m²,   m the picture of a perfect mirror of that roughness

    Returns:
        that roughness, that F0 within [0.05, 0.95], and n = 1, the middle of what F0 admits: no metal in particular.
    """
    assert model.table is not None
    mirror = model.table.mean(torch.float64)[:, :, 0]  # the first Chebyshev polynomial is 1: light under F = 1
    f0 = _share(mirror, photograph, weight).clamp(0.05, 0.95)
    error = ((f0[:, None] * mirror - photograph) * weight).abs().mean((1, 2))
    best = int(error.argmin())
    n = torch.ones_like(f0[best])
    return Metal(n, fresnel.extinction(f0[best], n), _levels(model)[best])


def glossy(model: PixelModel, photograph: Float[Tensor, "p 3"], weight: Float[Tensor, "p 3"]) -> Glossy:
    """A plastic of reflectance 0.04, whose colour is then a linear fit to what its reflection leaves over."""
    reflectance, half = torch.full((3,), PLASTIC).double(), torch.full((3,), 0.5).double()
    tried: list[tuple[float, Glossy]] = []
    for roughness in _levels(model):
        black = model.radiance(Glossy(torch.zeros_like(half), reflectance, roughness))
        grey = model.radiance(Glossy(half, reflectance, roughness)) - black
        color = (_share(grey, photograph - black, weight) * half).clamp(0.02, 0.95)
        material = Glossy(color, reflectance, roughness)
        tried.append((float(((model.radiance(material) - photograph) * weight).abs().mean()), material))
    return min(tried, key=lambda each: each[0])[1]


def matte(model: PixelModel, photograph: Float[Tensor, "p 3"], weight: Float[Tensor, "p 3"]) -> Matte:
    """A surface that is nearly Lambertian, whose colour is then a linear fit."""
    white, reflectance = torch.ones(3).double(), torch.full((3,), 0.9).double()
    color = _share(model.radiance(Matte(white, reflectance)), photograph, weight)
    return Matte(color.clamp(0.02, 0.98), reflectance)


def middling(kind: str, model: PixelModel) -> Material:
    """A material that reflects about half of the light; of what roughness, the median over pixels hardly asks."""
    half, one = torch.full((3,), 0.5).double(), torch.ones(3).double()
    quantities: Mapping[str, Callable[[], Tensor]] = {
        "n": lambda: one,
        "k": lambda: fresnel.extinction(half, one),
        "color": lambda: half,
        "reflectance": lambda: torch.full((3,), PLASTIC).double() if material_type(kind).mirrors else one,
        "roughness": lambda: _levels(model)[len(_levels(model)) // 2],
    }
    return made_of(kind, lambda name: quantities[name]())


STARTS: dict[str, Start] = {"metal": metal, "glossy": glossy, "matte": matte}


def _share(
    picture: Float[Tensor, "*a p 3"], photograph: Float[Tensor, "p 3"], weight: Float[Tensor, "p 3"]
) -> Float[Tensor, "*a 3"]:
    """The factor, per channel, by which a picture comes nearest to a photograph."""
    product, square = (weight**2 * picture * photograph).sum(-2), (weight**2 * picture**2).sum(-2)
    return product / square.clamp_min(torch.finfo(square.dtype).tiny)


def _levels(model: PixelModel) -> list[Float[Tensor, ""]]:
    table = model.table
    assert table is not None
    found = light_table.levels(table.low, table.high, table.light.shape[1], table.scale)
    return [torch.tensor(level, dtype=torch.float64) for level in found]
