"""Materials at the ends of their domains: silver, air, glass, white, black."""

from __future__ import annotations

from collections.abc import Sequence

from fit_material.fitter.selftest.claims import FINITE, between, float32, gradient, near, rising, sentence, within
from fit_material.fitter.selftest.experiments import material_experiments as made
from fit_material.fitter.selftest.experiments import references
from fit_material.fitter.selftest.experiments.row import Formula, Row, grid
from fit_material.shaders import shade
from fit_material.shaders.optics import fresnel, rough_plastic

COSINES = (0.0, 1e-8, 1e-3, 0.3, 0.8, 0.999, 1.0)
INDEX = {"cos_d": (0.0, 1.0), "n": (0.0, float("inf")), "k": (0.0, float("inf"))}
ROUNDINGS = 48  # of the conductor's formulas, each step counted, doubled for two quotients


def _metal(
    name: str, hard: str, n: Sequence[float], k: Sequence[float], slopes: bool = True, scale: float = 1.0
) -> Row:
    """F of metals over all angles; `scale` is what it changes over with n and k where that is less than they are."""
    scales = {"n": scale, "k": scale} if scale < 1 else {}
    formula = Formula(fresnel.conductor, grid(cos_d=COSINES, n=n, k=k), INDEX, scales)
    checked = (gradient("n", "k"),) if slopes else ()
    holds = (FINITE, between(0, 1), near(references.conductor, ROUNDINGS, relative=False), *checked)
    given = f"n = {_listed(n)}; k = {_listed(k)}; cosθ = {_listed(COSINES)}"
    return Row(name, hard, given, formula, holds, "Fresnel's amplitudes at 50 digits; finite differences")


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


ROWS = (
    _metal("silver", "n → 0: F is within 1e-7 of 1, its slope by n determines n", (1e-6, 0.01, 0.05), (1.0, 4.0)),
    _metal(
        "no-absorption",
        "k = 0, and k that is squared below the smallest number",
        (1.01, 1.5, 4.0),
        (0.0, 1e-25),
        scale=1e-3,
    ),
    _metal("strong-metals", "n or k of 10 and more, also n² - k² = 0", (0.5, 10.0, 100.0), (10.0, 100.0)),
    _metal("n-equals-k", "n² - k² cancels", (1e3, 1e6), (1e3, 1e6)),
    _metal("air", "n = 1, k = 0: nothing reflects, 0/0 at cosθ = 0", (1.0,), (0.0,), slopes=False),
    _metal("nearly-air", "(n - 1)² is below the rounding of n² + 1", (1 + 1e-6, 1 - 1e-6), (0.0, 1e-6), slopes=False),
    _metal(
        "total-reflection",
        "cosθ = 0.8 and n = 0.6: a root begins, with an infinite slope",
        (0.6,),
        (0.0, 1e-12),
        slopes=False,
    ),
    Row(
        "absorptance-of-mirrors",
        "1 - F where F → 1: subtracting F leaves no digit",
        "n = 1e-6 … 0.05, k = 1, 5; n = 1.5, k = 0; cosθ = 1e-8 … 1",
        Formula(fresnel.absorptance, grid(cos_d=(1e-8, 1e-4, 0.5, 1.0), n=(1e-6, 0.05, 1.5), k=(1.0, 5.0)), INDEX),
        (FINITE, between(0, 1), near(references.absorptance, ROUNDINGS), gradient("n", "k")),
        "Fresnel's amplitudes at 50 digits, relative",
    ),
    Row(
        "reflectance-near-air",
        "F of 1e-14 is the difference of two numbers near 1",
        "η = 1 + 1e-6, 1 + 1e-3; cosθ = 0.3, 1",
        Formula(fresnel.dielectric, grid(cos_d=(0.3, 1.0), ior=(1 + 1e-6, 1 + 1e-3)), {"cos_d": (0, 1)}, {"ior": 1e-7}),
        (FINITE, near(references.dielectric, 24), gradient()),
        "Fresnel's amplitudes at 50 digits, relative",
    ),
    Row(
        "dielectric-and-transmittance",
        "F and 1 - F have to add up to 1 where either is next to nothing",
        "η = 1 … 1e3, cosθ = 0 … 1",
        Formula(
            lambda cos_d, ior: fresnel.dielectric(cos_d, ior) + fresnel.transmittance(cos_d, ior),
            grid(cos_d=COSINES, ior=(1.0, 1.0001, 1.5, 10.0, 1e3)),
        ),
        (FINITE, between(1, 1, roundings=24)),
        "energy: F + (1 - F) = 1",
    ),
    Row(
        "f0-near-one",
        "F0 → 1 and → 0: n runs to 1/m and m, k to 0",
        "F0 = 1e-6 … 1 - 1e-5, n at both limits and between",
        made.extinction_returns,
        (within(lambda numbers: 64 * numbers.eps),),
        "F0 put back into n and k gives F0, whose 1 - F0 divides what rounding left",
    ),
    Row(
        "extinction-at-its-end",
        "k = √0 where n is at its limit, with an infinite slope, and none beyond",
        "r = 0 … 0.9, n = 0.01 … 100",
        Formula(fresnel.extinction, grid(r=(0.0, 1e-12, 0.25, 0.9), n=(0.01, 1.0, 3.0, 100.0))),
        (FINITE, between(0, float("inf"))),
        "domain: k >= 0",
    ),
    Row(
        "schlick-at-its-ends",
        "f = 0, f = 1, cosθ = 0, 1",
        "all four",
        Formula(
            fresnel.schlick,
            grid(cos_d=(0.0, 1e-8, 0.5, 1.0), f0=(0.0, 1e-9, 0.5, 1.0)),
            {"cos_d": (0, 1), "f0": (0, 1)},
        ),
        (FINITE, between(0, 1, roundings=2), gradient(), float32(8)),
        "float64; finite differences",
    ),
    Row(
        "lazanyi-at-its-ends",
        "n → 0 and k = 0, where F0 → 1 and → 0",
        "n = 1e-6, 1, 10; k = 0, 4, 100",
        Formula(fresnel.lazanyi, grid(cos_d=(0.0, 0.5, 1.0), n=(1e-6, 1.0, 10.0), k=(0.0, 4.0, 100.0)), INDEX),
        (FINITE, between(0, 1, roundings=8), gradient(), float32(16)),
        "float64; finite differences",
    ),
    Row(
        "f-falls-towards-the-normal",
        "Schlick's F is monotone, also where it rounds to 1",
        "f = 0.9999999, cosθ ascending from 0 to 1",
        Formula(fresnel.schlick, {"cos_d": [i / 200 for i in range(201)], "f0": [0.9999999] * 201}),
        (FINITE, rising("cos_d", -1)),
        "monotone by its formula",
    ),
    Row(
        "color-and-f-are-one",
        "color + F exactly 1, F = 1, color = 0: the guard's quotient is (1 - F)/color",
        "color, F in {0, 1e-7, 0.25, 0.5, 0.75, 1}²",
        Formula(
            made.guarded, grid(color=(0.0, 1e-7, 0.25, 0.5, 0.75, 1.0), reflectance=(0.0, 1e-7, 0.25, 0.5, 0.75, 1.0))
        ),
        (FINITE, between(0, 1, roundings=4)),
        "energy: color + F ≤ 1",
    ),
    Row(
        "guard-is-continuous",
        "color + F passes through 1",
        "color = 0.5 ± 1e-6 under F = 0.5",
        Formula(made.guarded_color, grid(color=(0.5 - 1e-6, 0.5, 0.5 + 1e-6), reflectance=(0.5,))),
        (FINITE, between(0.5 - 1e-6, 0.5, roundings=2)),
        "closed form: min(color, 1 - F)",
    ),
    Row(
        "crease",
        "a second bounce at F = 0, 1 and ao = 0, 1",
        "F, ao in {0, 0.5, 1}²",
        Formula(
            lambda f, openness: shade.double_bounce(f, openness),
            grid(f=(0.0, 0.5, 1.0), openness=(0.0, 0.5, 1.0)),
            {"f": (0, 1), "openness": (0, 1)},
        ),
        (FINITE, between(0, 1), gradient()),
        "finite differences",
    ),
    Row(
        "plastic-without-interface",
        "η = 1: nothing reflects, inside or outside; alpha = 0.005 … 2; grazing view",
        "µ = 0, 1e-6, 0.3, 1",
        Formula(
            lambda mu, eta, alpha: rough_plastic.transmittance(mu, eta, alpha, "ggx"),
            grid(mu=(0.0, 1e-6, 0.3, 1.0), eta=(1.0, 1.5, 10.0), alpha=(1e-6, 0.005, 0.3, 2.0)),
        ),
        (FINITE, between(0, 1, roundings=64)),
        "energy",
    ),
    Row(
        "plastic-of-diamond-and-beyond",
        "η of 10: 1 - R is a hundredth, and what leaves is divided by it",
        "η = 1.2, 1.6, 2.5, 10; alpha = 0.005 … 1",
        Formula(
            lambda eta, alpha: rough_plastic.outcoupling(eta, alpha, "ggx"),
            grid(eta=(1.2, 1.6, 2.5, 10.0), alpha=(0.005, 0.1, 1.0)),
            {"eta": (1, 100), "alpha": (0, 2)},
            {"eta": 0.01, "alpha": 0.0005},  # steps that pass few of the kinks where facets meet the horizon
        ),
        (FINITE, gradient(), float32(2000)),
        "float64, 1 - R ≥ 1/1000 magnifying roundings of 1; finite differences",
    ),
    Row(
        "plastic-keeps-energy",
        "a white body under an interface: what is let in, kept inside and mirrored adds up",
        "η = 1 … 10, alpha = 0.01, 0.2, 1, light from everywhere",
        made.plastic_albedo,
        (within(lambda numbers: 0.01, "bounded"),),
        "energy, 1 % being what Mitsuba's R, which this is, may be off",
    ),
    Row(
        "free-vectors-beyond-everything",
        "a solver's step may go to ±1000, where logistics are 0 and 1 and k = 0",
        "metal, glossy, matte at ±30, ±1000",
        made.corners,
        (sentence("finite"),),
        "finite",
    ),
    Row(
        "metals-return-from-their-free-vector",
        "k → 0: log n / log m → 1, whose artanh is infinite",
        "n = 0.02 … 20, k = 0, 1e-9 … 10",
        made.tints_return,
        (within(lambda numbers: 1e-7),),
        "the inverse; tanh(30) is 1 less 1e-25, k² = 1e-25 m² being what stands for 0",
    ),
)
