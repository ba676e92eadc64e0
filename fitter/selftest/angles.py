"""Angles at which directions, lookups and frames have no slope or no tangent."""

from __future__ import annotations

import math

from fit_material.fitter.selftest.claims import FINITE, between, gradient, near, sentence, within
from fit_material.fitter.selftest.experiments import angle_experiments as made
from fit_material.fitter.selftest.experiments import references
from fit_material.fitter.selftest.experiments.row import Formula, Row, grid
from fit_material.fitter.selftest.materials import INDEX
from fit_material.shaders.optics import blur, fresnel

ROWS = (
    Row(
        "conductor-at-grazing",
        "cosθ = 0, 1e-8: F is 1 less 1e-8, and its slope by cosθ the rest",
        "gold's red and silver's n and k",
        Formula(fresnel.conductor, grid(cos_d=(0.0, 1e-8, 1e-4), n=(0.05, 0.18), k=(3.4, 4.0)), INDEX, {"cos_d": 0.05}),
        (FINITE, between(0, 1), near(references.conductor, 48), gradient("cos_d")),
        "Fresnel's amplitudes at 50 digits; finite differences, one-sided at 0",
    ),
    Row(
        "absorptance-at-grazing",
        "cosθ = 1e-8: 1 - F is 1e-8",
        "gold's red, glass",
        Formula(fresnel.absorptance, grid(cos_d=(0.0, 1e-8, 1e-4), n=(0.18, 1.5), k=(0.0, 3.4)), INDEX),
        (FINITE, between(0, 1), near(references.absorptance, 48, floor=1e-45)),
        "Fresnel's amplitudes at 50 digits, relative",
    ),
    Row(
        "glass-at-grazing",
        "cosθ = 0, 1e-8, 1: F of a dielectric runs to 1 with its steepest slope",
        "η = 1.0001, 1.5, 2.5",
        Formula(
            fresnel.dielectric,
            grid(cos_d=(0.0, 1e-8, 0.5, 1.0), ior=(1.0001, 1.5, 2.5)),
            {"cos_d": (0, 1)},
            {"ior": 1e-5, "cos_d": 1e-3},
        ),
        (FINITE, between(0, 1), near(references.dielectric, 24), gradient()),
        "Fresnel's amplitudes at 50 digits; finite differences",
    ),
    Row(
        "transmittance-at-grazing",
        "1 - F → 0 with cosθ",
        "η = 1, 1.5, 2.5; cosθ = 0, 1e-8 … 1",
        Formula(fresnel.transmittance, grid(cos_d=(1e-8, 1e-3, 1.0), ior=(1.0, 1.5, 2.5)), {"cos_d": (0, 1)}),
        (FINITE, between(0, 1, roundings=4), near(references.transmittance, 24)),
        "Fresnel's amplitudes at 50 digits, relative",
    ),
    Row(
        "normal-turned-away",
        "an interpolated normal leans away from the viewer: n·v < 0",
        "n·v = -0.5 … 0; metal with blur and a lamp",
        Formula(made.turned_away, grid(cos=(-0.5, -1e-6, 0.0), n=(0.1, 1.0))),
        (FINITE, between(0, 50)),
        "finite; not negative",
    ),
    Row(
        "r-along-y",
        "the blur's horizontal axis has no direction; normal, view and r are one",
        "metal, glossy, matte seen along ±Y; ρ = 0, 1e-6, 0.5",
        made.every_material_at_the_poles,
        (sentence("finite"),),
        "finite, with slopes by normal, material and roughness",
    ),
    Row(
        "axes-beside-y",
        "(z, 0, -x) is shorter than any rounding, or has squares that underflow",
        "r leaning 0, 1e-30 … 1e-4 from ±Y",
        made.axes_beside_the_pole,
        (within(lambda numbers: max(16 * numbers.eps, blur.SHORTEST)),),
        "an orthonormal frame with a horizontal side; (1, 0, 0) stands for one within 1e-12 of ±Y",
    ),
    *(
        Row(
            f"map-at-{name}",
            "acos has an infinite slope there, and half of its digits",
            "1e-30 … 1e-4 rad from the pole",
            Formula(lambda x, z, up=up: made.looked_up_at_the_pole(x, z, up), grid(x=made.TINY, z=(0.0, 1e-4))),
            (FINITE, between(0, 1, roundings=4)),
            "texels in [0, 1]",
        )
        for name, up in (("+y", 1.0), ("-y", -1.0))
    ),
    Row(
        "polar-angle-near-the-pole",
        "acos of a float32 cosine resolves no angle below 3e-4, which is a texel of a map of 8192 columns",
        "1e-12 … 1e-2 rad from +Y",
        Formula(made.polar_angle, {"x": (1e-12, 1e-8, 1e-5, 1e-3, 1e-2)}, {"x": (0.0, 1.0)}),
        (FINITE, near(lambda x: x, 8), gradient()),
        "closed form: the angle itself",
    ),
    Row(
        "map-seam",
        "the last column meets the first",
        "1e-6 rad to either side, three rows",
        made.seam,
        (within(lambda numbers: 4e-6 * 16 / (2 * math.pi) + 64 * 16 * numbers.eps, "continuous"),),
        "a bilinear slope of at most 1 a texel",
    ),
    Row(
        "map-and-scene-turn-together",
        "a rotation of map and directions changes nothing",
        "37° about +Y",
        made.rotated,
        (within(lambda numbers: 64 * 16 * numbers.eps, "invariant"),),
        "the same map, not rotated",
    ),
    Row(
        "cube-edges-and-corners",
        "two faces meet at an edge, three at a corner, where there is no fourth texel",
        "12 edges, 8 corners, 1e-6 to either side",
        made.cube_edges,
        (within(lambda numbers: 4e-6 * 4 + 64 * 4 * numbers.eps, "continuous"),),
        "a bilinear slope of at most 1 a texel",
    ),
    Row(
        "slope-across-a-cube-edge",
        "where faces meet, the derivative of smooth light breaks by no more than OpenGL's filter, whose twin this is",
        "linear light on faces of 64² texels",
        made.cube_slopes,
        (within(lambda numbers: 3 / 64 + 64 * 64 * numbers.eps, "continuous"),),
        "light with one slope; OpenGL's kink by its closed form; bilinear slopes err by a texel's curvature",
    ),
    Row(
        "straight-view",
        "a view along the normal has no tangent",
        "0, 1e-30 … 1e-4 rad off",
        made.frames,
        (within(lambda numbers: 16 * numbers.eps),),
        "an orthonormal frame",
    ),
    Row(
        "lamp-behind-and-at-the-horizon",
        "the half vector of opposite directions is 0/0",
        "lamp at -v, at the horizon, at v; GGX, Beckmann",
        made.lamp_behind,
        (sentence("finite"),),
        "finite; not negative",
    ),
)
