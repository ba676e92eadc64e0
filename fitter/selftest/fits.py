"""Solvers at corners, at bounds, without rank, without numbers, without steps."""

from __future__ import annotations

import math

import torch

from fit_material.fitter.selftest.claims import sentence, within
from fit_material.fitter.selftest.experiments import fit_experiments as made
from fit_material.fitter.selftest.experiments import small_scene
from fit_material.fitter.selftest.experiments.photograph_experiments import FINITE_RESULT, undetermined
from fit_material.fitter.selftest.experiments.row import Row

SOUND = sentence("finite, no worse, honest")

ROWS = (
    Row(
        "every-corner",
        "logistics are flat there: no slope leads away",
        "F0, tint, alpha at ±6 of their logits",
        made.corners,
        (SOUND,),
        "the start's cost; the slope at the end",
        once=True,
    ),
    Row(
        "at-a-bound",
        "alpha at the end of its interval, k all but 0",
        "alpha's logit 20, tints 15",
        made.from_start(lambda: torch.tensor([0.0] * 3 + [15.0] * 3 + [20.0], dtype=torch.float64)),
        (SOUND,),
        "the start's cost; the slope at the end",
    ),
    Row(
        "beyond-the-domain",
        "unknowns at which nothing changes any more",
        "all at 1000",
        made.from_start(lambda: torch.full((7,), 1e3, dtype=torch.float64)),
        (SOUND,),
        "the start's cost; the slope at the end",
    ),
    Row(
        "at-the-truth",
        "the cost is 0, and every share of it",
        "a picture without noise, started at gold",
        made.at_the_truth,
        (within(lambda numbers: 1e-4),),
        "the material that made it",
    ),
    Row(
        "without-rank",
        "two unknowns act alike, a third does nothing",
        "a Jacobian of rank 2, of four unknowns; three solvers",
        made.without_rank,
        (SOUND,),
        "numpy's least squares",
        once=True,
    ),
    Row(
        "two-materials-with-one-picture",
        "Lazányi's formula sees F0 alone: every n, k on a circle renders alike",
        "n and k requested under the thesis's reflectance",
        made.told(made.by_f0_alone),
        (FINITE_RESULT, undetermined("n", "k", words="lies anywhere in")),
        "MODEL.md 1",
    ),
    Row(
        "one-step",
        "the limit comes before the end",
        "one step of each solver",
        made.few_steps,
        (SOUND,),
        "the word stopped",
    ),
    Row(
        "one-step-told",
        "a fit that was cut off has numbers, too",
        "one step",
        made.told(steps=1),
        (FINITE_RESULT, undetermined("f0", "n", "k", "alpha", words="stopped in 1 steps")),
        "the status stopped",
    ),
    Row(
        "nan-beyond-a-cliff",
        "the way to the minimum leads through NaN",
        "three solvers",
        made.survives(made.cliff, stopped=False),
        (SOUND,),
        "finite",
        once=True,
    ),
    Row(
        "nan-everywhere",
        "no step has a number",
        "three solvers",
        made.survives(made.nowhere, stopped=True),
        (SOUND,),
        "the word stopped",
        once=True,
    ),
    Row(
        "residuals-of-1e152",
        "their squares overflow",
        "exp(700 x) from x = 0.5; three solvers",
        made.survives(made.exploding, stopped=False),
        (SOUND,),
        "finite",
        once=True,
    ),
    Row(
        "rounded-table",
        "a light table in float32",
        "the same table, rounded",
        made.single_precision,
        (within(lambda numbers: 16 * numbers.eps / small_scene.NOISE * math.sqrt(270) + 1e-4),),
        "the fit by float64's: each pixel moves by ε/noise standard errors, √270 of them at most",
    ),
    Row(
        "pixels-in-another-order",
        "sums in another order",
        "a permutation of the pixels",
        made.moves(made.permuted),
        (within(made.tolerance, "invariant"),),
        "the fit before; the solver's tolerance",
    ),
    Row(
        "channels-in-another-order",
        "nothing knows red from blue",
        "channels permuted, of light and photograph",
        made.moves(made.channels, lambda x: x[[1, 2, 0, 4, 5, 3, 6]]),
        (within(made.tolerance, "invariant"),),
        "the fit before; the solver's tolerance",
    ),
    Row(
        "all-brighter",
        "thresholds that are absolute",
        "light and photograph 2²⁰ times as bright",
        made.moves(made.scaled),
        (within(made.tolerance, "invariant"),),
        "the fit before; the solver's tolerance",
    ),
)
