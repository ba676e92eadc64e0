"""Quantities of materials as data. No torch, so that the command line may read it at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Quantity:
    """A quantity of materials.

    Attributes:
        name: the word in Python, JSON, reports and GLSL.
        symbol: in equations.
        meaning: in words, for tables.
        channels: 3 where red, green and blue have one each, else 1.
        domain: least and largest value of any material; beyond, the formulas lose their digits.
        resolved: relative and absolute half width of a 95 % interval that counts as determined, of which the wider
            one holds: beyond it the interval no longer separates one metal from its neighbours.
        mtl: key of the thesis's MTL dialect; None where it has none.
        unit: of the values; all of today's are numbers without one.
    """

    name: str
    symbol: str
    meaning: str
    channels: Literal[1, 3]
    domain: tuple[float, float]
    resolved: tuple[float, float]
    mtl: Literal["Kd", "Ka", "Ks"] | None = None
    unit: str = "1"


N = Quantity("n", "n", "refractive index", 3, (1e-5, 1e5), (0.1, 0.0), "Kd")
K = Quantity("k", "k", "extinction coefficient", 3, (0.0, 1e5), (0.1, 0.0), "Ka")
F0 = Quantity("f0", "F₀", "reflectance from the front", 3, (0.0, 1.0), (0.05, 0.02))
ALPHA = Quantity("alpha", "α", "microfacet width", 1, (1e-4, 10.0), (0.25, 0.005))
ROUGHNESS = Quantity("roughness", "ρ", "blur radius ρ of the viewer", 1, (0.0, 1e6), (0.25, 0.02), "Ks")
COLOR = Quantity("color", "c", "diffuse colour", 3, (0.0, 1.0), (0.05, 0.02), "Kd")
REFLECTANCE = Quantity("reflectance", "f", "reflectance", 3, (0.0, 1.0), (0.05, 0.005), "Ka")

INDEX = (N.name, K.name)
"""The complex refractive index, of which neither is known without the other."""

QUANTITIES = {each.name: each for each in (N, K, F0, ALPHA, ROUGHNESS, COLOR, REFLECTANCE)}
"""All quantities by name, in the order of tables."""
