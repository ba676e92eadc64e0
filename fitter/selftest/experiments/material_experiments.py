"""What is done with materials at the ends of their domains."""

from __future__ import annotations

import itertools

import torch
from torch import Tensor

from fit_material.fitter.materials.coordinates import Coordinates, WidthInterval
from fit_material.fitter.materials.glossy import GlossyCoordinates
from fit_material.fitter.materials.matte import MatteCoordinates
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.selftest.experiments.row import Numbers
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.optics import diffuse, fresnel, rough_plastic


def extinction_returns(numbers: Numbers) -> float:
    """How far F0 comes back from n and k, in units of 1 - F0: worst of many."""
    worst = 0.0
    for r, share in itertools.product((1e-6, 0.04, 0.5, 0.99, 1 - 1e-5), (0.0, 0.3, 1.0)):
        reflectivity = numbers.tensor(r)
        n = fresnel.index_limit(reflectivity) ** (2 * share - 1)
        found = fresnel.normal_reflectance(n, fresnel.extinction(reflectivity, n))
        worst = max(worst, abs(float(found - reflectivity)))
    return worst


def guarded(color: Tensor, reflectance: Tensor) -> Tensor:
    """Colour and F together, of one channel."""
    return diffuse.energy_guard(color[:, None], reflectance[:, None])[:, 0] + reflectance


def guarded_color(color: Tensor, reflectance: Tensor) -> Tensor:
    return diffuse.energy_guard(color[:, None], reflectance[:, None])[:, 0]


def plastic_albedo(numbers: Numbers) -> float:
    """By how much more a white plastic sends back than it receives from everywhere: the most of many.

    Its interface mirrors F(µ) where it is smooth; of a rough one only what comes from inside is counted.
    """
    worst, (mu, weight) = -1.0, _gauss_legendre(numbers)
    for eta, alpha in itertools.product((1.0, 1.0001, 1.5, 3.0, 10.0), (0.005, 0.2, 1.0)):
        index, width = numbers.tensor(eta), numbers.tensor(alpha)
        passed = rough_plastic.transmittance(mu, index, width, "ggx")
        sent = passed * rough_plastic.outcoupling(index, width, "ggx") * (2 * weight * mu * passed).sum()
        mirrored = fresnel.dielectric(mu, index) * (alpha < 0.1) * (mu > 0.1)
        worst = max(worst, float((sent + mirrored).max()) - 1)
    return worst


def _gauss_legendre(numbers: Numbers) -> tuple[Tensor, Tensor]:
    import numpy as np

    x, weight = np.polynomial.legendre.leggauss(24)
    return numbers.tensor((x + 1) / 2), numbers.tensor(weight / 2)


def corners(numbers: Numbers) -> str | None:
    """Free vectors far beyond everything have finite materials with finite derivatives."""
    for coordinates in _unbounded():
        for corner in itertools.product((-1e3, -30.0, 30.0, 1e3), repeat=2):
            x = torch.full((coordinates.size,), corner[0], dtype=torch.float64)
            x[3:] = corner[1]
            x.requires_grad_()
            material = coordinates.material(x)
            told = list(material.numbers.values())
            slope = torch.autograd.grad(torch.stack([value.sum() for value in told]).sum(), x)[0]
            back = coordinates.free(material)
            if not all(each.isfinite().all() for each in (*told, slope, back)):
                return f"{material} at {corner}, with {slope.tolist()} and back {back.tolist()}"
    return None


def _unbounded() -> tuple[Coordinates, ...]:
    """The free vectors of all types."""
    metal, glossy = MetalCoordinates(WidthInterval(0.005, 1.2, True)), GlossyCoordinates(WidthInterval(0.005, 1.2))
    return metal, glossy, MatteCoordinates()


def tints_return(numbers: Numbers) -> float:
    """How far n comes back from its own free vector, relative, also where k is all but 0: worst of many."""
    coordinates, worst = MetalCoordinates(WidthInterval(0.005, 1.2, True)), 0.0
    for n, k in itertools.product((0.02, 0.5, 0.999, 1.5, 20.0), (0.0, 1e-9, 1e-4, 1.0, 10.0)):
        index, extinct = (torch.full((3,), value, dtype=torch.float64) for value in (n, k))
        metal = Metal(index, extinct, Microfacet(torch.tensor(0.1, dtype=torch.float64)))
        found = coordinates.material(coordinates.free(metal))
        worst = max(worst, float((found.n / n - 1).abs().max()), float((found.k - k).abs().max()) / max(n, k, 1))
    return worst
