"""Lobes from a mirror's to ones wider than the hemisphere."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import get_args

import torch

from fit_material.fitter.selftest.claims import FINITE, between, gradient, near, rising, within
from fit_material.fitter.selftest.experiments import lobe_experiments as made
from fit_material.fitter.selftest.experiments import references
from fit_material.fitter.selftest.experiments.row import Formula, Row, grid
from fit_material.shaders.optics import microfacets
from fit_material.shaders.optics.microfacets import Distribution

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
        lambda cos_h, alpha: microfacets.distribution_of_normals(cos_h, alpha, distribution),
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


ROWS = (
    *(_density("ggx", alpha, SLOPES, references.ggx) for alpha in (2e-6, 1e-3, 1.0, 3.0)),
    *(_density("beckmann", alpha, SLOPES[:4], references.beckmann) for alpha in (2e-6, 1e-3, 1.0, 3.0)),
    *(
        Row(
            f"{distribution}-density-by-its-sine",
            "a lobe so narrow that its cosines round to 1 in float32",
            "θ = 1e-5 … 3e-3 under alpha = 1e-3, given by sin²θ as well",
            Formula(made.by_angle(distribution), {"angle": (1e-5, 3e-4, 1e-3, 3e-3)}, {}, {"angle": 1e-5}),
            (FINITE, near(made.by_angle_exactly(distribution), 32), gradient()),
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
                lambda cos_h, alpha, distribution=distribution: microfacets.distribution_of_normals(
                    cos_h, alpha, distribution
                ),
                grid(cos_h=(1e-8, 0.5, 1.0), alpha=(0.0, 1e-9)),
            ),
            (FINITE, between(0, 1.001 / (math.pi * microfacets.MIRROR**2))),
            "the lobe of alpha = 1e-6, below which none is distinguished",
        )
        for distribution in get_args(Distribution)
    ),
    *(
        Row(
            f"{distribution}-is-normalised",
            "lobes wider than the hemisphere keep their normals inside of it",
            "alpha = 0.05, 0.3, 1, 3",
            made.normalisation(distribution),
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
            lambda cos, alpha: microfacets.smith_g1(cos, alpha, "ggx"),
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
            lambda cos, alpha: microfacets.smith_g1(cos, alpha, "ggx"),
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
            lambda cos, alpha: microfacets.smith_g1(cos, alpha, "beckmann"),
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
            lambda cos, alpha: microfacets.smith_g1(cos, alpha, "ggx"),
            {"cos": [0.3] * 61, "alpha": [i / 20 for i in range(61)]},
        ),
        (FINITE, rising("alpha", -1)),
        "monotone by its formula",
    ),
    Row(
        "white-furnace",
        "no lobe sends back more than it gets, from a mirror's to three times the hemisphere's, at any view",
        "alpha = 1e-6 … 3, n·v = 1e-6 … 1",
        made.white_furnace,
        (within(lambda numbers: 32 * numbers.eps, "bounded"),),
        "energy",
    ),
    Row(
        "normals-of-a-mirror",
        "alpha = 0: no facet is tilted, whatever the view",
        "n·v = 1e-6, 0.5, 1; the rim of the disc of samples",
        made.normal_of_a_mirror,
        (within(lambda numbers: 4 * numbers.eps),),
        "closed form: h = n",
    ),
    Row(
        "visible-normals-and-their-slopes",
        "sinθ = √0 at a straight view; the rim of the disc, where the third side is √0; alpha = 0",
        "n·v = 1e-6 … 1, alpha = 0 … 3",
        Formula(
            lambda cos_v, alpha, u1: torch.stack(
                microfacets.sample_visible_normals(cos_v, alpha, u1, 0.3 + 0 * u1)
            ).sum(0),
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
            lambda rho: made.blurred(rho), {"rho": (0.0, 1e-6, 1e-3, 1.0, 3.0)}, {"rho": (0.0, math.inf)}, {"rho": 0.1}
        ),
        (FINITE, near(made.blurred_by_hand, 16), gradient()),
        "the sum of MODEL.md 3.1 by plain loops; finite differences, one-sided at 0",
    ),
    Row(
        "blur-narrower-than-a-texel",
        "49 taps within one texel are one lookup",
        "ρ = 1e-6, faces of 8² texels",
        made.narrower_than_a_texel,
        (within(lambda numbers: 4 * 8e-6 + 64 * 8 * numbers.eps),),
        "the plain lookup: a bilinear slope of 8 texels per unit, of at most 4 between texels",
    ),
    Row(
        "blur-wider-than-everything",
        "weights add to 1 whatever ρ is",
        "ρ = 0 … 1e6 under constant light",
        made.constant_through_any_blur,
        (within(lambda numbers: 16 * numbers.eps),),
        "closed form: 1",
    ),
    Row(
        "lamp-in-a-lobe",
        "exp(-x²/2σ²)/σ: squares underflow, the exponential is none, and both have slopes",
        "ρ = 1e-3 … 10, |r - l| = 0.001 … 1.9",
        Formula(made.lamp_reflection, grid(distance=(1e-3, 0.1, 1.9), rho=(1e-3, 0.1, 1.0, 10.0)), {}, {"rho": 1e-3}),
        (FINITE, gradient("rho")),
        "finite differences",
    ),
    Row(
        "lamp-in-a-mirror",
        "ρ = 0: a mirror shows no point light, and no NaN either",
        "ρ = 0, 1e-30, 1e-7; |r - l| = 1e-6, 1",
        Formula(made.lamp_reflection, grid(distance=(1e-6, 1.0), rho=(0.0, 1e-30, 1e-7))),
        (FINITE, between(0, 0)),
        "closed form: 0",
    ),
    Row(
        "lamp-of-a-lobe",
        "a density of 1/σ = 2e5 beside the lamp",
        "ρ = 1e-5 … 10, l = r",
        Formula(lambda rho: made.lamp_reflection(0 * rho, rho), {"rho": (1e-5, 1e-3, 1.0, 10.0)}),
        (FINITE, near(lambda rho: references.gaussian(1e-18, rho / 2), 8)),
        "the formula at 50 digits",
    ),
    Row(
        "roughness-beyond-the-table",
        "a polynomial through the levels explodes beyond them",
        "alpha = 0, 1e-9, 0.005, 0.1, 1.2, 50 in a table of 0.005 … 1.2",
        Formula(made.level_weights, {"roughness": (0.0, 1e-9, 0.005, 0.1, 1.2, 50.0)}),
        (FINITE, between(-1, 1, roundings=64)),
        "Chebyshev's weights within their span",
    ),
    Row(
        "roughness-at-the-levels",
        "interpolation meets the levels themselves",
        "alpha at each of five levels",
        made.weights_of_levels,
        (within(lambda numbers: 256 * numbers.eps),),
        "closed form: one weight is 1, the others 0",
    ),
)
