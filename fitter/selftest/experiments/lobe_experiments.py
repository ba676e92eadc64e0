"""What is done with lobes from a mirror's to ones wider than the hemisphere."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import torch
from torch import Tensor

from fit_material.fitter.selftest.experiments import references
from fit_material.fitter.selftest.experiments.row import Numbers
from fit_material.renderer.compute import chebyshev
from fit_material.renderer.environment import cubemap
from fit_material.renderer.environment.cubemap import Cubemap
from fit_material.renderer.light_tables.light_table import LightTable
from fit_material.shaders.optics import blur, microfacets
from fit_material.shaders.optics.microfacets import Distribution


def by_angle(distribution: Distribution) -> Callable[[Tensor], Tensor]:
    def density(angle: Tensor) -> Tensor:
        width = angle.new_tensor(1e-3)
        return microfacets.distribution_of_normals(torch.cos(angle), width, distribution, torch.sin(angle) ** 2)

    return density


def by_angle_exactly(distribution: Distribution) -> Callable[[float], float]:
    reference = references.ggx if distribution == "ggx" else references.beckmann
    return lambda angle: reference(references.cosine(angle), 1e-3)


def normalisation(distribution: Distribution) -> Callable[[Numbers], float]:
    def off(numbers: Numbers) -> float:
        """∫ D cosθ dω - 1, by Gauss–Legendre in s = tan θ/α = (1 + x)/(1 - x): cosθ dω = 2π α² s/(1 + α²s²)² ds."""
        import numpy as np

        x, weight = (numbers.tensor(each) for each in np.polynomial.legendre.leggauss(200))
        s, worst = (1 + x) / (1 - x), 0.0
        for alpha in (0.05, 0.3, 1.0, 3.0):
            cos_h = torch.rsqrt(1 + (alpha * s) ** 2)
            density = microfacets.distribution_of_normals(cos_h, numbers.tensor(alpha), distribution)
            measure = 2 * math.pi * alpha**2 * s * cos_h**4 * 2 / (1 - x) ** 2
            worst = max(worst, abs(float((density * measure * weight).sum()) - 1))
        return worst

    return off


def white_furnace(numbers: Numbers) -> float:
    """By how much more than 1 the mean weight of a lobe's own directions is, under any width and view: the most."""
    u1, u2 = (numbers.tensor(each) for each in torch.rand(2, 4096, generator=torch.Generator().manual_seed(1)).unbind())
    worst = -1.0
    for alpha, cos in itertools.product((1e-6, 1e-3, 0.1, 1.0, 3.0), (1e-6, 1e-3, 0.3, 1.0)):
        cos_v = numbers.tensor(cos).expand_as(u1)
        x, _, z = microfacets.sample_visible_normals(cos_v, alpha, u1, u2)
        cos_d = ((1 - cos_v**2).sqrt() * x + cos_v * z).clamp(0, 1)
        weight = microfacets.reflected(cos_v, 2 * cos_d * z - cos_v, z.clamp_min(1e-6), alpha, "ggx")
        weight = weight / microfacets.visible_normal_density(cos_v, z.clamp_min(1e-6), alpha)
        worst = max(worst, float(weight.mean()) - 1) if weight.isfinite().all() else math.inf
    return worst


def normal_of_a_mirror(numbers: Numbers) -> float:
    """How far sampled normals of α = 0 lie from the surface's."""
    u1, u2 = (numbers.tensor([0.0, 0.3, 0.999999]), numbers.tensor([0.0, 0.5, 0.9]))
    found = [microfacets.sample_visible_normals(numbers.tensor([cos] * 3), 0.0, u1, u2) for cos in (1e-6, 0.5, 1.0)]
    return max(float((torch.stack(each) - numbers.tensor([[0.0], [0.0], [1.0]])).abs().max()) for each in found)


def linear(directions: Tensor) -> Tensor:
    """Light that is linear in the direction: its blur is known."""
    return 2 + directions @ directions.new_tensor([[0.3, 0.1, 0.0], [0.5, 0.2, 0.1], [-0.4, 0.0, 0.2]])


def blurred(rho: Tensor) -> Tensor:
    r = torch.nn.functional.normalize(rho.new_tensor([0.3, -0.5, 0.8]), dim=0)
    return torch.stack([blur.blur(linear, r, each)[0] for each in rho])


def blurred_by_hand(rho: float) -> float:
    """The double sum of MODEL.md 3.1, by plain loops in float64."""
    r = torch.nn.functional.normalize(torch.tensor([0.3, -0.5, 0.8], dtype=torch.float64), dim=0)
    k_h = torch.tensor([r[2], 0.0, -r[0]], dtype=torch.float64) / math.hypot(r[0], r[2])
    k_v, found, total = torch.linalg.cross(k_h, r), 0.0, 0.0
    for i, j in itertools.product(range(-3, 4), repeat=2):
        weight = math.exp(-0.5 * (i * i + j * j) / 1.5**2)
        tap = r + rho / 3 * (i * k_h + j * k_v)
        found += weight * float(linear(tap / tap.norm())[0])
        total += weight
    return found / total


def narrower_than_a_texel(numbers: Numbers) -> float:
    """A blur of ρ = 1e-6 against the plain lookup, over the faces of a coarse cubemap."""
    cube = Cubemap(
        torch.rand(6, 8, 8, 3, generator=torch.Generator().manual_seed(2)).to(numbers.dtype).to(numbers.device)
    )
    r = cubemap.face_directions(5).to(numbers.device, numbers.dtype).reshape(-1, 3)
    found = blur.blur(lambda towards: cubemap.lookup(cube, towards), r, numbers.tensor(1e-6))
    return float((found - cubemap.lookup(cube, r)).abs().max())


def constant_through_any_blur(numbers: Numbers) -> float:
    r = cubemap.face_directions(5).to(numbers.device, numbers.dtype).reshape(-1, 3)
    return max(
        float((blur.blur(torch.ones_like, r, numbers.tensor(rho)) - 1).abs().max())
        for rho in (0.0, 1e-6, 1.0, 10.0, 1e6)
    )


def lamp_reflection(distance: Tensor, rho: Tensor) -> Tensor:
    """A lamp's reflection by the distance between l and r."""
    z = 1 - distance**2 / 2
    r = torch.stack([(distance**2 - distance**4 / 4).clamp_min(1e-36).sqrt(), 0 * z, z], -1)
    towards = r.new_tensor([0.0, 0.0, 1.0])
    return torch.stack([blur.light_reflection(a[None], towards, b)[0, 0] for a, b in zip(r, rho, strict=True)])


def level_weights(roughness: Tensor) -> Tensor:
    """The table's share of its first level, inside of its span and far beyond."""
    table = LightTable(torch.zeros(2, 5, 1, 1, 3), 0.005, 1.2, "log")
    return torch.stack([table.level_weights(each)[0] for each in roughness])


def weights_of_levels(numbers: Numbers) -> float:
    """How far the weights at each of the levels are from choosing it alone."""
    table = LightTable(torch.zeros(2, 5, 1, 1, 3), 0.005, 1.2, "log")
    found = torch.stack(
        [table.level_weights(numbers.tensor(level)) for level in chebyshev.levels(0.005, 1.2, 5, "log")]
    )
    return float((found - torch.eye(5).to(found)).abs().max())
