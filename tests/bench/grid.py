"""Metals × roughnesses × real environments, photographed by Mitsuba: what is found, the truth, and the bound.

Photographs are traced once, by one process; the fits may run in several.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from fit_material.fitter.result.schema import Result
from tests.bench.cramer_rao import Bound, bounds_of
from tests.bench.estimates import DETERMINED, NOTHING, SLICES, Estimate, curve_error, estimate_of, true_numbers
from tests.bench.fits import How, attempt, in_processes
from tests.bench.photographs import ENVIRONMENTS, Case
from tests.bench.setting import spread

METALS = ("Au", "Ag", "Cu", "Al", "Fe", "Cr", "Ti", "W")
ALPHAS = (0.05, 0.1, 0.2, 0.4)
SPP, NOISE = 1024, 0.01
F0_GOAL, CURVE_GOAL, ALPHA_GOAL, WIDTH_GOAL = 0.003, 0.01, 0.01, 1.5
BY_DEFAULT = How()
NAMES = [f"{key} {channel}" for key in ("F0", "n", "k") for channel in "RGB"] + ["alpha"]


@dataclass(frozen=True)
class Selection:
    """Which part of a grid, and how to go through it.

    Attributes:
        how: what the fits are told.
        jobs: fits at a time.
        repeats: of noise, where it is drawn again and again.
    """

    metals: Sequence[str] = METALS
    alphas: Sequence[float] = ALPHAS
    environments: Sequence[str] = ENVIRONMENTS
    how: How = BY_DEFAULT
    jobs: int = 1
    repeats: int = 200

    def cases(self, **fixed: object) -> list[Case]:
        """All combinations, each of noise of its own; those that share their light and geometry follow each other."""
        found = product(self.environments, self.alphas, self.metals)
        cases = [Case(metal, alpha, environment, **fixed) for environment, alpha, metal in found]  # type: ignore[arg-type]
        return [case.with_noise_of_its_own for case in cases]


@dataclass(frozen=True)
class Outcome:
    """One fit beside the truth and the bounds.

    Attributes:
        result: of the fit, or what went wrong.
        independent, joint: Cramér-Rao bounds, with a pixel's channels taken for independent, and with their covariance.
    """

    case: Case
    result: Result | str
    independent: Bound
    joint: Bound

    @property
    def found(self) -> Estimate:
        return NOTHING if isinstance(self.result, str) else estimate_of(self.result.materials[0])

    @property
    def status(self) -> str:
        """How the fit ended."""
        return self.result if isinstance(self.result, str) else self.result.status

    @property
    def seconds(self) -> float:
        """Wall time of the fit; NaN where it went wrong."""
        return math.nan if isinstance(self.result, str) else self.result.time.total

    @property
    def truth(self) -> Float[np.ndarray, "10"]:
        return true_numbers(self.case)

    @property
    def f0_error(self) -> float:
        """Largest over the channels, absolute; as all errors NaN where the fit found no metal."""
        return float(np.abs(self.found.value - self.truth)[SLICES["f0"]].max())

    @property
    def alpha_error(self) -> float:
        """Relative."""
        return float(abs(self.found.value[-1] / self.truth[-1] - 1))

    @property
    def curve_error(self) -> float:
        """Largest difference of the reflectance curves."""
        return curve_error(self.found.value, self.truth)

    def widths(self, keys: str = "nk", joint: bool = False) -> Float[np.ndarray, " q"]:
        """Half widths over the bound's, of the given keys."""
        ratios = self.found.over(self.joint if joint else self.independent)
        return np.concatenate([ratios[SLICES[key]] for key in keys])

    @property
    def misses(self) -> list[str]:
        """Which figures it does not keep, and by what."""
        too_wide = [
            f"{name} × {ratio:.2f}"
            for name, ratio in zip(NAMES[3:9], self.widths(), strict=True)
            if not ratio <= WIDTH_GOAL
        ]
        errors = {"F0": (self.f0_error, F0_GOAL), "curve": (self.curve_error, CURVE_GOAL)}
        errors["alpha, relative"] = (self.alpha_error, ALPHA_GOAL)
        failed = [self.result] if isinstance(self.result, str) else []
        return failed + [f"{key} {error:.4f}" for key, (error, goal) in errors.items() if not error <= goal] + too_wide


def rows(
    variant: str, selection: Selection, shape: str = "sphere", noise: float = 0.0, spp: int = SPP
) -> Iterator[str]:
    """Lines of Markdown: every case, figures of groups of them, and what is missed."""
    cases = selection.cases(shape=shape, noise=noise, spp=spp)
    yield f"{shape}, 3 views of 128², {spp} samples a pixel, {noise:.0%} noise added; {selection.how}."
    yield "Found ± half width of the 95 % interval, `?` where that is not below a tenth of the value; then the half"
    yield "width over the Cramér-Rao bound's, channels taken for independent / with their covariance, and in brackets"
    yield "the error in stated standard errors."
    yield ""
    yield "| environment | metal | | alpha | F0 R G B | n R G B | k R G B | curve | s |"
    yield "|---|---|---|---|---|---|---|---|---|"
    outcomes = []
    for outcome in outcomes_of(cases, variant, selection):
        outcomes.append(outcome)
        yield from _case_rows(outcome)
    yield ""
    yield from summary(outcomes)


def outcomes_of(cases: Sequence[Case], variant: str, selection: Selection) -> Iterator[Outcome]:
    """Every case, in order; photographs and bounds come first."""
    bounds = [bounds_of(case, variant) for case in cases]
    scenes = [case.scene(variant) for case in cases]
    results = in_processes(partial(attempt, how=selection.how), scenes, selection.jobs)
    for case, result, (independent, joint) in zip(cases, results, bounds, strict=True):
        yield Outcome(case, result, independent, joint)


def summary(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """Figures by group, and the cases that do not keep them."""
    columns = ("F0", "curve", "alpha, %", "n, k: half width / bound", "/ joint bound", "in 95 % interval", "determined")
    yield f"| group | cases | {' | '.join(columns)} |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for name, group in _groups(outcomes):
        yield _group_row(name, group)
    yield ""
    yield f"Errors: 95th percentile, worst (goals {F0_GOAL}, {CURVE_GOAL}, {ALPHA_GOAL:.0%}); widths: median, 90th"
    yield f"percentile, worst (goal {WIDTH_GOAL}); share of all numbers ± binomial error, and the error"
    yield "by whole fits, whose ten numbers share their noise (goal 93 to 97 %); share of n"
    yield f"and of k whose half width is below {DETERMINED:.0%} of the value."
    yield ""
    missing = [(outcome.case.label, outcome.misses) for outcome in outcomes if outcome.misses]
    yield f"{len(missing)} of {len(outcomes)} cases miss a figure:"
    yield ""
    for label, misses in missing:
        yield f"- {label}: {'; '.join(misses)}"
    yield f"- wall time of a fit: {spread([s for outcome in outcomes if not math.isnan(s := outcome.seconds)])} s"


def share(holds: np.ndarray) -> str:
    """A share in per cent with its binomial error."""
    p = float(np.mean(holds))
    return f"{p:.1%} ± {(p * (1 - p) / holds.size) ** 0.5:.1%}"


def _groups(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, list[Outcome]]]:
    yield "all", list(outcomes)
    keys: list[Callable[[Case], str]] = [lambda c: c.environment, lambda c: f"alpha {c.alpha:g}", lambda c: c.metal]
    for key in keys:
        names = dict.fromkeys(key(outcome.case) for outcome in outcomes)
        for name in names if len(names) > 1 else ():
            yield name, [outcome for outcome in outcomes if key(outcome.case) == name]


def _group_row(name: str, group: Sequence[Outcome]) -> str:
    errors = [
        _percentiles([scale * getattr(each, key) for each in group], (95, 100), form)
        for key, scale, form in (("f0_error", 1, ".4f"), ("curve_error", 1, ".4f"), ("alpha_error", 100, ".2f"))
    ]
    widths = [
        _percentiles(np.concatenate([each.widths(joint=joint) for each in group]), (50, 90, 100), ".3g")
        for joint in (False, True)
    ]
    holds = np.stack([each.found.holds(each.truth) for each in group])
    known = [np.concatenate([each.found.is_determined[SLICES[key]] for each in group]).mean() for key in "nk"]
    held = share(holds) if len(holds) == 1 else f"{share(holds)}, {_between_fits(holds):.1%}"
    cells = [*errors, *widths, held, "n {:.0%}, k {:.0%}".format(*known)]
    return f"| {name} | {len(group)} | {' | '.join(cells)} |"


def _between_fits(holds: Bool[np.ndarray, "m 10"]) -> float:
    """Standard error of the share that hold, of independent fits whose own numbers may stand and fall together."""
    return float(holds.mean(1).std(ddof=1) / len(holds) ** 0.5)


def _percentiles(values: Sequence[float] | np.ndarray, ranks: Sequence[float], form: str) -> str:
    """Where a fit found no metal its errors count as infinite."""
    known = np.nan_to_num(np.asarray(values, float), nan=np.inf)
    return ", ".join(format(value, form) for value in np.percentile(known, ranks, method="higher"))


def _case_rows(outcome: Outcome) -> Iterator[str]:
    case, found, truth = outcome.case, outcome.found, outcome.truth
    order = ("alpha", "f0", "n", "k")
    true = " | ".join(" ".join(f"{value:.4f}" for value in truth[SLICES[key]]) for key in order)
    yield f"| {case.environment} | {case.metal} | true | {true} | | |"
    told = [
        f"{value:.4f} ± {half:.2g}{'' if known else '?'}"
        for value, half, known in zip(found.value, found.half_width, found.is_determined, strict=True)
    ]
    cells = " | ".join(", ".join(told[SLICES[key]]) for key in order)
    yield f"| | | {outcome.status} | {cells} | {outcome.curve_error:.4f} | {outcome.seconds:.1f} |"
    triples = zip(found.over(outcome.independent), found.over(outcome.joint), found.deviation(truth), strict=True)
    standardised_residuals = [f"{ratio:.2f}/{joint:.2f} ({deviation:+.1f})" for ratio, joint, deviation in triples]
    cells = " | ".join(", ".join(standardised_residuals[SLICES[key]]) for key in order)
    yield f"| | | / bound (error/σ) | {cells} | | |"


def every_shape(variant: str, selection: Selection, shapes: Sequence[str], spp: int) -> Iterator[str]:
    """The clean grid for each of several shapes."""
    for shape in shapes:
        yield from rows(variant, selection, shape, spp=spp)
        yield ""


def spot(variant: str, selection: Selection) -> Iterator[str]:
    """The mesh Spot, of two metals where none are asked for."""
    return rows(variant, replace(selection, metals=("Au", "Fe")) if selection.metals == METALS else selection, "spot")
