"""Environments with exploding suns, single texels, none at all, and numbers that are none."""

from __future__ import annotations

import math

import numpy as np

from fit_material.fitter.selftest.claims import refused, within
from fit_material.fitter.selftest.experiments import light_experiments as made
from fit_material.fitter.selftest.experiments.row import Claim, Row

ROWS = (
    *(
        Row(
            f"sun-of-{sun:g}",
            f"one texel is {sun / made.DIM:g} times as bright as the rest",
            f"a sun of {sun:g} in a map of {made.DIM:g}: table, irradiance, density",
            made.every_light(sun),
            (Claim("finite", made.not_finite),),
            "finite; not negative",
        )
        for sun in (1e5, 1e9, 1e20)
    ),
    *(
        Row(
            f"irradiance-under-a-sun-of-{sun:g}",
            "a sum of bright and dim texels: where the sun is below the horizon the dim ones are all there is",
            f"a sun of {sun:g} in a map of {made.DIM:g}, three normals, one turned away",
            made.irradiance_off(sun),
            (within(lambda numbers: 3e-3),),
            "midpoints of 960 × 1920 in float64; blocks of light are said to err by 1e-3, of one lamp by twice that",
        )
        for sun in (1.0, 1e5, 1e9)
    ),
    Row(
        "one-bright-texel",
        "directions of the lobe never meet it",
        "one texel of 1e6 over 1e-6",
        made.drawn_light,
        (within(lambda numbers: 5.0),),
        "∫ L dω on a grid of 600 × 1200, float64; five standard errors",
    ),
    Row(
        "constant-light",
        "white facets and a white body return what they get, and no more",
        "1 from everywhere",
        made.constant,
        (within(lambda numbers: 2e-3, "bounded"),),
        "energy; blocks of the map err by 1e-3",
    ),
    Row(
        "two-texels",
        "rows are one, columns two; the other texel is a sun of 1e9",
        "1 × 2 pixels",
        made.tiny_map,
        (Claim("finite", made.not_finite),),
        "finite; not negative",
    ),
    Row(
        "map-of-8192-by-4096",
        "a float32 angle has 2e-7 of a turn, which is 2e-3 of a texel",
        "lookups at texels' middles, also beside the poles",
        made.huge_map,
        (within(lambda numbers: 8192 * 16 * numbers.eps + 8192 * 8 * 2.0**-23),),
        "the texel itself; 16 roundings of a turn, and 8 of the map's own float32, each of 8192",
    ),
    Row(
        "smaller-map",
        "a sun of 1e9 and the dim rest both keep their light",
        "64 × 128 to 16 × 32",
        made.lost_by_filtering,
        (within(lambda numbers: 1e-9),),
        "Σ L Δω, of each part",
    ),
    Row(
        "brighter-light",
        "scaling the light scales the table and nothing else",
        "2²⁰ times as bright",
        made.scaled,
        (within(made.rounding, "invariant"),),
        "the same table, scaled",
    ),
    Row(
        "half-floats",
        "65504 and 2⁻²⁴ in a file of float16",
        "EXR of half floats",
        made.half_floats,
        (within(lambda numbers: 0.0),),
        "the numbers written",
    ),
    Row(
        "black-light",
        "no light at all: nothing can be drawn in proportion to it",
        "a map of zeros",
        made.read(np.zeros((4, 8, 3))),
        (refused("no texel is a finite number above 0"),),
        "a refusal",
    ),
    Row(
        "light-that-is-nan",
        "not one number",
        "a map of NaN",
        made.read(np.full((4, 8, 3), np.nan)),
        (refused("no texel is a finite number above 0"),),
        "a refusal",
    ),
    Row(
        "negative-texel",
        "rings of a filter leave negative light",
        "a texel of -3",
        made.read(made.map_with(r1c2=-3.0)),
        (made.repaired(1, 0.0),),
        "0, counted",
    ),
    Row(
        "nan-texel",
        "one NaN would be everywhere",
        "a texel of NaN",
        made.read(made.map_with(r1c2=math.nan)),
        (made.repaired(1, 1.0),),
        "the mean of its neighbours, counted",
    ),
    Row(
        "infinite-texel",
        "a sun beyond the format's largest number",
        "a texel of ∞",
        made.read(made.map_with(r1c2=math.inf)),
        (made.repaired(1, 1.0),),
        "the mean of its neighbours, counted",
    ),
    Row(
        "nan-among-suns",
        "the sum of eight bright neighbours overflows, their mean does not",
        "a texel of NaN among texels of 3e38",
        made.read(np.where(made.map_with(r1c2=math.nan) == 1, 3e38, np.nan)),
        (made.repaired(1, 3e38),),
        "the mean of its neighbours, counted",
    ),
    Row(
        "not-a-map",
        "a map that is not twice as wide as high",
        "3 × 4 pixels",
        made.read(np.ones((3, 4, 3))),
        (refused("twice as wide as high"),),
        "a refusal",
    ),
)
