"""Which type of material explains the photographs best: candidates fitted side by side, an information criterion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from fitter.noise import relative_weight, scatter
from fitter.residuals import ROBUST_AT, huber
from fitter.result import MaterialType
from fitter.search import Fit, Problem, draft, fit_material, refined

KINDS: tuple[MaterialType, ...] = ("metal", "glossy", "matte")
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
        return Choice(fit_material(problem, kind), {kind: 0.0})
    drafts: dict[MaterialType, Fit] = {each: draft(problem, each) for each in KINDS}
    rough = _criteria(drafts)
    count = drafts["matte"].residuals.photograph.numel()
    hopeful: list[MaterialType] = [each for each in KINDS if _is_hopeful(each, rough, count)]
    fits: dict[MaterialType, Fit] = {each: refined(problem, drafts[each]) for each in hopeful}
    criteria = _criteria(fits)
    best = min(criteria, key=criteria.__getitem__)
    return Choice(fits[best], {**rough, **criteria})


def _is_hopeful(kind: MaterialType, rough: Mapping[MaterialType, float], count: int) -> bool:
    """Whether a draft of so many values may win once it is refined.

    Where the matte one is best, none other may: it is a glossy one that mirrors nothing, and if mirroring gained
    nothing by a coarse table, it gains nothing by a fine one.
    """
    if rough["matte"] == 0:
        return kind == "matte"
    return rough[kind] <= count * math.log(HOPELESS)


def _criteria(fits: Mapping[MaterialType, Fit]) -> dict[MaterialType, float]:
    """Schwarz's Bayesian information criterion of each fit, against the least.

        BIC = m ln(Σψ²/m) + p ln m        [Schwarz 1978, for a normal error of unknown scatter]

    m values, p parameters, ψ the robust relative difference to the photographs, which below `ROUNDING` says nothing.
    Every fit is weighed alike; all are fits of the same pixels.
    """
    differences: dict[MaterialType, Tensor] = {kind: _relative_difference(fit) for kind, fit in fits.items()}
    least = max(min(scatter(each) for each in differences.values()), ROUNDING)
    bic: dict[MaterialType, float] = {}
    for kind, difference in differences.items():
        count = difference.numel()
        mean_square = float(huber(difference, ROBUST_AT * least).square().mean())
        bic[kind] = count * math.log(max(mean_square, ROUNDING**2)) + len(fits[kind].x) * math.log(count)
    best = min(bic.values())
    return {kind: each - best for kind, each in bic.items()}


def _relative_difference(fit: Fit) -> Float[Tensor, "p 3"]:
    factors = fit.residuals.factors(fit.x)
    return fit.residuals.difference(fit.x) / factors * relative_weight(fit.residuals.photograph / factors)
