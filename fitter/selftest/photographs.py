"""Photographs that show nothing, next to nothing, or the same again."""

from __future__ import annotations

import numpy as np
import torch

from fit_material.fitter.selftest.claims import refused, within
from fit_material.fitter.selftest.experiments import photograph_experiments as made
from fit_material.fitter.selftest.experiments.row import Claim, Row
from fit_material.fitter.selftest.experiments.small_scene import PIXELS

ROWS = (
    Row(
        "all-clipped",
        "no pixel says anything but 'brighter than this'",
        "PNG of 255",
        made.read(np.full((4, 4, 3), 255, np.uint8)),
        (refused("clipped throughout"),),
        "a refusal",
    ),
    Row(
        "all-black",
        "no light at all",
        "PNG of 0",
        made.read(np.zeros((4, 4, 3), np.uint8)),
        (refused("black inside the mask"),),
        "a refusal",
    ),
    Row(
        "all-nan",
        "no number at all",
        "EXR of NaN",
        made.read(np.full((4, 4, 3), np.nan, np.float32)),
        (refused("NaN or infinite throughout"),),
        "a refusal",
    ),
    Row(
        "beyond-float32",
        "squares leave float32",
        "EXR of 1e30",
        made.read(np.full((4, 4, 3), 1e30, np.float32)),
        (refused("radiance of 1e+30"),),
        "a refusal",
    ),
    Row(
        "one-nan",
        "one NaN is in every sum",
        "EXR with one pixel of NaN",
        made.read(made.with_pixel(np.nan)),
        (Claim("left out and counted", made.left_out),),
        "15 pixels of 16",
    ),
    Row(
        "one-infinite",
        "∞ - ∞",
        "EXR with one pixel of ∞",
        made.read(made.with_pixel(np.inf)),
        (Claim("left out and counted", made.left_out),),
        "15 pixels of 16",
    ),
    Row(
        "one-pixel",
        "three numbers for seven unknowns",
        "one pixel at 55°",
        made.seen(pixels=torch.tensor([40])),
        (made.FINITE_RESULT, made.undetermined("f0", "n", "k", "alpha", words="only 1 pixels show it")),
        "counting: nothing is determined",
    ),
    Row(
        "no-grazing-pixel",
        "n and k part only near grazing angles",
        "pixels with n·v > 0.8",
        lambda numbers: made.seen(pixels=made.front())(numbers),
        (made.FINITE_RESULT, made.undetermined("n", "k", words="no pixel beyond")),
        "MODEL.md 1: curves of equal F0 differ beyond 60°",
    ),
    Row(
        "nothing-but-noise",
        "half of the pixels are negative, and the median is none",
        "noise of 0.01 about 0",
        made.seen(made.only_noise),
        (made.FINITE_RESULT, made.undetermined("n", "k", "alpha", words="photographs and fit differ by")),
        "no light, no verdict",
        once=True,
    ),
    Row(
        "one-black-channel",
        "relative noise of nothing: a weight of 1/0",
        "blue is 0 everywhere",
        made.seen(made.black_channel),
        (
            made.FINITE_RESULT,
            Claim(
                "honest",
                lambda found, numbers: None if found.material.f0[2] < 0.05 else f"F0 of blue is {found.material.f0[2]}",
            ),
        ),
        "F0 of blue is 0",
        once=True,
    ),
    Row(
        "one-outlier",
        "a pixel of 1e6 among pixels of 1 outweighs all others squared",
        "one pixel of ninety is 1e6",
        made.moved_by(made.one_outlier),
        (within(lambda numbers: 1.0, "robust"),),
        "the fit without it: less than a standard error, of which Huber's loss leaves 6/√90 = 0.6",
    ),
    Row(
        "a-hundred-identical-files",
        "noise that is counted a hundred times makes errors ten times too small",
        "one file in a hundred tables, and once more by another camera",
        made.told_apart,
        (Claim("honest", lambda found, numbers: None if found == [0, 100] else f"takes {found} for new ones"),),
        "counting: the first of them and the other camera's",
        once=True,
    ),
    Row(
        "a-photograph-again",
        "the same pixels twice",
        "every pixel twice",
        made.moved_by(lambda photograph: photograph, torch.arange(PIXELS).repeat(2)),
        (within(lambda numbers: 0.05, "invariant"),),
        "the fit of one; the prior weighs half",
    ),
    Row(
        "a-photograph-a-hundred-times",
        "100 identical photographs",
        "every pixel a hundred times",
        made.moved_by(lambda photograph: photograph, torch.arange(PIXELS).repeat(100)),
        (within(lambda numbers: 0.1, "invariant"),),
        "the fit of one; the prior weighs a hundredth",
        once=True,
    ),
)
