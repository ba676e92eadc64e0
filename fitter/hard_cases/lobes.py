"""Lobes from a mirror's to ones wider than the hemisphere."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import get_args

import torch
from torch import Tensor

from fitter.hard_cases import references
from fitter.hard_cases.claims import FINITE, between, gradient, near, rising, within
from fitter.hard_cases.materials import grid
from fitter.hard_cases.row import Formula, Numbers, Row
from renderer import cubemap, transport
from renderer.cubemap import Cubemap
from renderer.transport import LightTable
from shaders import lobe
from shaders.lobe import Distribution

WIDTHS = (0.0, 1e-6, 1e-3, 0.1, 1.0, 3.0)
SLOPES = (0.0, 0.5, 1.0, 3.0, 30.0)  # tangents over alpha
UNIT = {"cos_h": (0.0, 1.0), "cos": (0.0, 1.0), "alpha": (0.0, math.inf)}


def _density(
    distribution: Distribution, alpha: float, slopes: tuple[float, ...], reference: Callable[..., float]
) -> Row:
    """D of one width, where it is large and where it is none."""
    cosines = [1 / math.hypot(1, alpha * slope) for slope in slopes]
    scale = {"cos_h": 0.1 * min(1.0, alpha**2), "alpha": 0.1 * alpha}
    formula = Formula(
        lambda cos_h, alpha: lobe.distribution_of_normals(cos_h, alpha, distribution),
        grid(cos_h=cosines, alpha=(alpha,)),
        UNIT,
        scale,
    )
    highest = 1.001 / (math.pi * alpha**2) if alpha < 0.5 else 4 * alpha**2 / math.pi
    slopes_of = () if alpha > 1e-4 else ("alpha",)  # float64 has no cosines to take differences between, of θ = 1e-6
    return Row(
        f"{distribution}-density-of-{alpha:g}",
        "a peak of 1/πα² beside none at all; 1 - cosθ holds few digits",
        f"alpha = {alpha:g}, tan θ = 0 … {slopes[-1]:g} alpha",
        formula,
        (FINITE, between(0, highest), near(reference, 64, floor=1e-30), gradient(*slopes_of)),
        "the formula at 50 digits; finite differences",
    )


def _by_angle(distribution: Distribution) -> Callable[[Tensor], Tensor]:
    def density(angle: Tensor) -> Tensor:
        width = angle.new_tensor(1e-3)
        return lobe.distribution_of_normals(torch.cos(angle), width, distribution, torch.sin(angle) ** 2)

    return density


def _by_angle_exactly(distribution: Distribution) -> Callable[[float], float]:
    reference = references.ggx if distribution == "ggx" else references.beckmann
    return lambda angle: reference(references.cosine(angle), 1e-3)


def _normalisation(distribution: Distribution) -> Callable[[Numbers], float]:
    def off(numbers: Numbers) -> float:
        """∫ D cosθ dω - 1, by Gauss–Legendre in s = tan θ/α = (1 + x)/(1 - x): cosθ dω = 2π α² s/(1 + α²s²)² ds."""
        import numpy as np

        x, weight = (numbers.tensor(each) for each in np.polynomial.legendre.leggauss(200))
        s, worst = (1 + x) / (1 - x), 0.0
        for alpha in (0.05, 0.3, 1.0, 3.0):
            cos_h = torch.rsqrt(1 + (alpha * s) ** 2)
            density = lobe.distribution_of_normals(cos_h, numbers.tensor(alpha), distribution)
            measure = 2 * math.pi * alpha**2 * s * cos_h**4 * 2 / (1 - x) ** 2
            worst = max(worst, abs(float((density * measure * weight).sum()) - 1))
        return worst

    return off


def _white_furnace(numbers: Numbers) -> float:
    """By how much more than 1 the mean weight of a lobe's own directions is, under any width and view: the most."""
    u1, u2 = (numbers.tensor(each) for each in torch.rand(2, 4096, generator=torch.Generator().manual_seed(1)).unbind())
    worst = -1.0
    for alpha, cos in itertools.product((1e-6, 1e-3, 0.1, 1.0, 3.0), (1e-6, 1e-3, 0.3, 1.0)):
        cos_v = numbers.tensor(cos).expand_as(u1)
        x, _, z = lobe.sample_visible_normals(cos_v, alpha, u1, u2)
        cos_d = ((1 - cos_v**2).sqrt() * x + cos_v * z).clamp(0, 1)
        weight = lobe.reflected(cos_v, 2 * cos_d * z - cos_v, z.clamp_min(1e-6), alpha, "ggx")
        weight = weight / lobe.visible_normal_density(cos_v, z.clamp_min(1e-6), alpha)
        worst = max(worst, float(weight.mean()) - 1) if weight.isfinite().all() else math.inf
    return worst


def _normal_of_a_mirror(numbers: Numbers) -> float:
    """How far sampled normals of α = 0 lie from the surface's."""
    u1, u2 = (numbers.tensor([0.0, 0.3, 0.999999]), numbers.tensor([0.0, 0.5, 0.9]))
    found = [lobe.sample_visible_normals(numbers.tensor([cos] * 3), 0.0, u1, u2) for cos in (1e-6, 0.5, 1.0)]
    return max(float((torch.stack(each) - numbers.tensor([[0.0], [0.0], [1.0]])).abs().max()) for each in found)


def _linear(directions: Tensor) -> Tensor:
    """Light that is linear in the direction: its blur is known."""
    return 2 + directions @ directions.new_tensor([[0.3, 0.1, 0.0], [0.5, 0.2, 0.1], [-0.4, 0.0, 0.2]])


def _blurred(rho: Tensor) -> Tensor:
    r = torch.nn.functional.normalize(rho.new_tensor([0.3, -0.5, 0.8]), dim=0)
    return torch.stack([lobe.blur(_linear, r, each)[0] for each in rho])


def _blurred_by_hand(rho: float) -> float:
    """The double sum of MODEL.md 3.1, by plain loops in float64."""
    r = torch.nn.functional.normalize(torch.tensor([0.3, -0.5, 0.8], dtype=torch.float64), dim=0)
    k_h = torch.tensor([r[2], 0.0, -r[0]], dtype=torch.float64) / math.hypot(r[0], r[2])
    k_v, found, total = torch.linalg.cross(k_h, r), 0.0, 0.0
    for i, j in itertools.product(range(-3, 4), repeat=2):
        weight = math.exp(-0.5 * (i * i + j * j) / 1.5**2)
        tap = r + rho / 3 * (i * k_h + j * k_v)
        found += weight * float(_linear(tap / tap.norm())[0])
        total += weight
    return found / total


def _narrower_than_a_texel(numbers: Numbers) -> float:
    """A blur of ρ = 1e-6 against the plain lookup, over the faces of a coarse cubemap."""
    cube = Cubemap(
        torch.rand(6, 8, 8, 3, generator=torch.Generator().manual_seed(2)).to(numbers.dtype).to(numbers.device)
    )
    r = cubemap.face_directions(5).to(numbers.device, numbers.dtype).reshape(-1, 3)
    found = lobe.blur(lambda towards: cubemap.lookup(cube, towards), r, numbers.tensor(1e-6))
    return float((found - cubemap.lookup(cube, r)).abs().max())


def _constant_through_any_blur(numbers: Numbers) -> float:
    r = cubemap.face_directions(5).to(numbers.device, numbers.dtype).reshape(-1, 3)
    return max(
        float((lobe.blur(torch.ones_like, r, numbers.tensor(rho)) - 1).abs().max())
        for rho in (0.0, 1e-6, 1.0, 10.0, 1e6)
    )


def _light(distance: Tensor, rho: Tensor) -> Tensor:
    """A lamp's reflection by the distance between l and r."""
    z = 1 - distance**2 / 2
    r = torch.stack([(distance**2 - distance**4 / 4).clamp_min(1e-36).sqrt(), 0 * z, z], -1)
    towards = r.new_tensor([0.0, 0.0, 1.0])
    return torch.stack([lobe.light_reflection(a[None], towards, b)[0, 0] for a, b in zip(r, rho, strict=True)])


def _level_weights(roughness: Tensor) -> Tensor:
    """The table's share of its first level, inside of its span and far beyond."""
    table = LightTable(torch.zeros(2, 5, 1, 1, 3), 0.005, 1.2, "log")
    return torch.stack([table.level_weights(each)[0] for each in roughness])


def _weights_of_levels(numbers: Numbers) -> float:
    """How far the weights at each of the levels are from choosing it alone."""
    table = LightTable(torch.zeros(2, 5, 1, 1, 3), 0.005, 1.2, "log")
    found = torch.stack(
        [table.level_weights(numbers.tensor(level)) for level in transport.levels(0.005, 1.2, 5, "log")]
    )
    return float((found - torch.eye(5).to(found)).abs().max())


ROWS = (
    *(_density("ggx", alpha, SLOPES, references.ggx) for alpha in (2e-6, 1e-3, 1.0, 3.0)),
    *(_density("beckmann", alpha, SLOPES[:4], references.beckmann) for alpha in (2e-6, 1e-3, 1.0, 3.0)),
    *(
        Row(
            f"{distribution}-density-by-its-sine",
            "a lobe so narrow that its cosines round to 1 in float32",
            "θ = 1e-5 … 3e-3 under alpha = 1e-3, told by sin²θ as well",
            Formula(_by_angle(distribution), {"angle": (1e-5, 3e-4, 1e-3, 3e-3)}, {}, {"angle": 1e-5}),
            (FINITE, near(_by_angle_exactly(distribution), 32), gradient()),
            "the formula at 50 digits; finite differences",
        )
        for distribution in get_args(Distribution)
    ),
    *(
        Row(
            f"{distribution}-density-of-a-mirror",
            "alpha = 0: 0/0 beside the normal and 1/0 on it; also far off, where cosθ is 1e-8",
            "alpha = 0, cosθ = 1e-8, 0.5, 1",
            Formula(
                lambda cos_h, alpha, distribution=distribution: lobe.distribution_of_normals(
                    cos_h, alpha, distribution
                ),
                grid(cos_h=(1e-8, 0.5, 1.0), alpha=(0.0, 1e-9)),
            ),
            (FINITE, between(0, 1.001 / (math.pi * lobe.MIRROR**2))),
            "the lobe of alpha = 1e-6, below which none is told apart",
        )
        for distribution in get_args(Distribution)
    ),
    *(
        Row(
            f"{distribution}-is-normalised",
            "lobes wider than the hemisphere keep their normals inside of it",
            "alpha = 0.05, 0.3, 1, 3",
            _normalisation(distribution),
            (within(lambda numbers: 1e-9 + 4e3 * numbers.eps),),
            "∫ D cosθ dω = 1 by quadrature; (1 - cosθ)'s rounding over θ² = 0.05² at its tenth",
        )
        for distribution in get_args(Distribution)
    ),
    Row(
        "masking-at-its-ends",
        "cosθ = 0 and below, 1e-8, 1; alpha = 0: cos² underflows, tan is infinite",
        "alpha = 0 … 3, cosθ = -0.5 … 1",
        Formula(
            lambda cos, alpha: lobe.smith_g1(cos, alpha, "ggx"),
            grid(cos=(-0.5, 0.0, 1e-30, 1e-8, 0.5, 1.0), alpha=WIDTHS),
        ),
        (FINITE, between(0, 1, roundings=4)),
        "a share",
    ),
    Row(
        "masking-of-ggx",
        "a grazing direction and a narrow lobe meet at cosθ = alpha",
        "alpha = 1e-3 … 3, cosθ = 1e-8 … 1",
        Formula(
            lambda cos, alpha: lobe.smith_g1(cos, alpha, "ggx"),
            grid(cos=(1e-8, 0.5, 0.9), alpha=(1e-3, 0.1, 3.0)),
            UNIT,
            {"cos": 1e-9, "alpha": 1e-3},
        ),
        (near(references.ggx_masking, 16), gradient("alpha")),
        "the formula at 50 digits; finite differences",
    ),
    Row(
        "masking-of-beckmann-at-its-ends",
        "a = 1/(α tan) is infinite where nothing is masked",
        "alpha = 0 … 3, cosθ = -0.5 … 1",
        Formula(
            lambda cos, alpha: lobe.smith_g1(cos, alpha, "beckmann"),
            grid(cos=(-0.5, 0.0, 1e-30, 1e-8, 0.5, 1.0), alpha=WIDTHS),
        ),
        (FINITE, between(0, 1 + 2e-4)),
        "a share; the rational form ends 1e-4 above 1",
    ),
    Row(
        "masking-grows-with-alpha",
        "no dip where the rational form meets 1",
        "GGX, alpha ascending from 0 to 3 at cosθ = 0.3",
        Formula(
            lambda cos, alpha: lobe.smith_g1(cos, alpha, "ggx"),
            {"cos": [0.3] * 61, "alpha": [i / 20 for i in range(61)]},
        ),
        (FINITE, rising("alpha", -1)),
        "monotone by its formula",
    ),
    Row(
        "white-furnace",
        "no lobe sends back more than it gets, from a mirror's to three times the hemisphere's, at any view",
        "alpha = 1e-6 … 3, n·v = 1e-6 … 1",
        _white_furnace,
        (within(lambda numbers: 32 * numbers.eps, "bounded"),),
        "energy",
    ),
    Row(
        "normals-of-a-mirror",
        "alpha = 0: no facet is tilted, whatever the view",
        "n·v = 1e-6, 0.5, 1; the rim of the disc of samples",
        _normal_of_a_mirror,
        (within(lambda numbers: 4 * numbers.eps),),
        "closed form: h = n",
    ),
    Row(
        "visible-normals-and-their-slopes",
        "sinθ = √0 at a straight view; the rim of the disc, where the third side is √0; alpha = 0",
        "n·v = 1e-6 … 1, alpha = 0 … 3",
        Formula(
            lambda cos_v, alpha, u1: torch.stack(lobe.sample_visible_normals(cos_v, alpha, u1, 0.3 + 0 * u1)).sum(0),
            grid(cos_v=(1e-6, 0.5, 1.0), alpha=WIDTHS, u1=(1e-6, 0.5, 0.999999)),
        ),
        (FINITE, between(-math.sqrt(3), math.sqrt(3))),
        "components of a unit vector",
    ),
    Row(
        "blur-by-rho",
        "the slope by ρ at exactly 0; taps wider than the hemisphere",
        "ρ = 0, 1e-6, 1e-3, 1, 3 in light that is linear in the direction",
        Formula(
            lambda rho: _blurred(rho), {"rho": (0.0, 1e-6, 1e-3, 1.0, 3.0)}, {"rho": (0.0, math.inf)}, {"rho": 0.1}
        ),
        (FINITE, near(_blurred_by_hand, 16), gradient()),
        "the sum of MODEL.md 3.1 by plain loops; finite differences, one-sided at 0",
    ),
    Row(
        "blur-narrower-than-a-texel",
        "49 taps within one texel are one lookup",
        "ρ = 1e-6, faces of 8² texels",
        _narrower_than_a_texel,
        (within(lambda numbers: 4 * 8e-6 + 64 * 8 * numbers.eps),),
        "the plain lookup: a bilinear slope of 8 texels per unit, of at most 4 between texels",
    ),
    Row(
        "blur-wider-than-everything",
        "weights add to 1 whatever ρ is",
        "ρ = 0 … 1e6 under constant light",
        _constant_through_any_blur,
        (within(lambda numbers: 16 * numbers.eps),),
        "closed form: 1",
    ),
    Row(
        "lamp-in-a-lobe",
        "exp(-x²/2σ²)/σ: squares underflow, the exponential is none, and both have slopes",
        "ρ = 1e-3 … 10, |r - l| = 0.001 … 1.9",
        Formula(_light, grid(distance=(1e-3, 0.1, 1.9), rho=(1e-3, 0.1, 1.0, 10.0)), {}, {"rho": 1e-3}),
        (FINITE, gradient("rho")),
        "finite differences",
    ),
    Row(
        "lamp-in-a-mirror",
        "ρ = 0: a mirror shows no point light, and no NaN either",
        "ρ = 0, 1e-30, 1e-7; |r - l| = 1e-6, 1",
        Formula(_light, grid(distance=(1e-6, 1.0), rho=(0.0, 1e-30, 1e-7))),
        (FINITE, between(0, 0)),
        "closed form: 0",
    ),
    Row(
        "lamp-of-a-lobe",
        "a density of 1/σ = 2e5 beside the lamp",
        "ρ = 1e-5 … 10, l = r",
        Formula(lambda rho: _light(0 * rho, rho), {"rho": (1e-5, 1e-3, 1.0, 10.0)}),
        (FINITE, near(lambda rho: references.gaussian(1e-18, rho / 2), 8)),
        "the formula at 50 digits",
    ),
    Row(
        "roughness-beyond-the-table",
        "a polynomial through the levels explodes beyond them",
        "alpha = 0, 1e-9, 0.005, 0.1, 1.2, 50 in a table of 0.005 … 1.2",
        Formula(_level_weights, {"roughness": (0.0, 1e-9, 0.005, 0.1, 1.2, 50.0)}),
        (FINITE, between(-1, 1, roundings=64)),
        "Chebyshev's weights within their span",
    ),
    Row(
        "roughness-at-the-levels",
        "interpolation meets the levels themselves",
        "alpha at each of five levels",
        _weights_of_levels,
        (within(lambda numbers: 256 * numbers.eps),),
        "closed form: one weight is 1, the others 0",
    ),
)
