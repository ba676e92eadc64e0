"""Which type of material explains the photographs best: candidates fitted side by side, an information criterion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit, Problem, draft, fit_material, refined
from fit_material.fitter.estimation.roughness_survey import surveyed
from fit_material.fitter.least_squares.noise import relative_weight, scatter
from fit_material.fitter.least_squares.residuals import ROBUST_AT, huber
from fit_material.shaders.materials.kinds import KINDS, MaterialType

HOPELESS = 2.0  # times the least squared difference at the drafts' accuracy: no refinement makes up for that
ROUNDING = 1e-5  # relative, of single precision through tables, levels and lookups
DECISIVE = 10.0  # of a difference in BIC: "very strong" [Kass & Raftery 1995, table]


@dataclass(frozen=True)
class Choice:
    """A fit, and how it compared with those of the other types.

    Attributes:
        fit: the chosen one.
        criteria: BIC of each type, refined ones or drafts, against the chosen one's, which is 0; one entry where the
            type was given.
    """

    fit: Fit
    criteria: Mapping[MaterialType, float]

    @property
    def runner_up(self) -> tuple[MaterialType, float] | None:
        """The next best type, and how much worse its criterion is."""
        others: dict[MaterialType, float] = {
            kind: bic for kind, bic in self.criteria.items() if kind != self.fit.material.type
        }
        return min(others.items(), key=lambda each: each[1]) if others else None


def fit_type(problem: Problem, kind: MaterialType | None) -> Choice:
    """Fit a material of the given type, or of the type that explains the pixels best."""
    if kind is not None:
        return Choice(surveyed(problem, fit_material(problem, kind)), {kind: 0.0})
    drafts: dict[MaterialType, Fit] = {each: draft(problem, each) for each in KINDS}
    rough = _criteria(drafts)
    count = drafts["matte"].residuals.photograph.numel()
    hopeful: list[MaterialType] = [each for each in KINDS if _is_hopeful(each, rough, count)]
    fits: dict[MaterialType, Fit] = {each: refined(problem, drafts[each]) for each in hopeful}
    criteria = _criteria(fits)
    best = min(criteria, key=criteria.__getitem__)
    return Choice(surveyed(problem, fits[best]), {**rough, **criteria})


def _is_hopeful(kind: MaterialType, rough: Mapping[MaterialType, float], count: int) -> bool:
    """Whether a draft of so many values may win once it is refined.

    Where the matte one is best, none other may: it is a glossy one that mirrors nothing, and if mirroring gained
    nothing by a coarse table, it gains nothing by a fine one.
    """
    best = [each for each, behind in rough.items() if behind == 0 and not KINDS[each].mirrors]
    if best:
        return kind in best
    return rough[kind] <= count * math.log(HOPELESS)


def _criteria(fits: Mapping[MaterialType, Fit]) -> dict[MaterialType, float]:
    """Schwarz's Bayesian information criterion of each fit, against the least.

        BIC = m ln(Σ ψ_A ψ_B/m) + p ln m        [Schwarz 1978, for a normal error of unknown scatter]

    m values, p parameters, ψ the robust relative difference to the photographs, below `ROUNDING` mere rounding.
    Every fit is weighed alike; all are fits of the same pixels. A and B are the halves of the light table, whose noise
    is no misfit: a body has none, and so would seem to explain what a rough metal reflects. Their product's mean is
    known no better than by its own scatter.
    """
    halves: dict[MaterialType, list[Tensor]] = {kind: _relative_differences(fit) for kind, fit in fits.items()}
    least = max(min(scatter((first + second) / 2) for first, second in halves.values()), ROUNDING)
    bic: dict[MaterialType, float] = {}
    for kind, (first, second) in halves.items():
        whole = (first + second) / 2
        length = whole.norm(dim=-1, keepdim=True).clamp_min(ROUNDING)
        share = huber(whole, ROBUST_AT * least).norm(dim=-1, keepdim=True).clamp_min(ROUNDING) / length
        crossed, count = share**2 * first * second, whole.numel()
        mean_square = max(float(crossed.mean()), float(crossed.std()) / math.sqrt(count), ROUNDING**2)
        bic[kind] = count * math.log(mean_square) + len(fits[kind].x) * math.log(count)
    best = min(bic.values())
    return {kind: each - best for kind, each in bic.items()}


def _relative_differences(fit: Fit) -> list[Float[Tensor, "p 3"]]:
    """Of either half of the light table, at the measured pixels: a bad fit keeps bounds as well."""
    residuals = fit.residuals
    factors, own = residuals.factors(fit.x), residuals.is_measured
    weight = relative_weight((residuals.photograph / factors)[own])
    return [(half.difference(fit.x) / factors)[own] * weight for half in residuals.halves]
