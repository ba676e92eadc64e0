"""A fit in the words and numbers of `result.json`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.estimation.model_selection import DECISIVE, Choice
from fit_material.fitter.estimation.viewer_roughness import ViewerRoughness
from fit_material.fitter.fitted.determinability import Seen, on_the_prior, sees_f0_only, verdicts
from fit_material.fitter.least_squares.covariance import Covariance, is_determined
from fit_material.fitter.materials.registry import FITTABLE
from fit_material.fitter.metal_prior.borrowed import Borrowed, TooFar
from fit_material.fitter.metal_prior.substitution import from_prior, with_prior
from fit_material.fitter.result.schema import (
    CHANNELS,
    Determined,
    FittedMaterial,
    Intervals,
    Nearest,
    StandardErrors,
    Status,
)
from fit_material.fitter.uncertainty.correlation import correlation
from fit_material.fitter.uncertainty.estimates import (
    Measured,
    measured,
    of_viewer,
    paired,
    reported_quantities,
    resolution,
    unseen,
)
from fit_material.shaders.materials.kinds import KINDS
from fit_material.shaders.materials.quantities import ALPHA, ROUGHNESS, K, N
from fit_material.shaders.materials.widths import RHO_PER_ALPHA

T = TypeVar("T")

NO_METAL_BEYOND = 0.995  # silver, the most reflective, has F0 = 0.988


def fitted_material(
    name: str,
    fit: Fit,
    spread: Covariance,
    rho: ViewerRoughness | None,
    nearest: Sequence[Nearest],
    borrowed: Borrowed | TooFar | None = None,
) -> FittedMaterial:
    """The material with its errors, intervals and verdicts.

    A number that the photographs do not constrain beyond its domain has that domain for its interval and no error.

    Args:
        name: of the material.
        fit: what was found, as `fitter.uncertainty.active_bound.reported` has it.
        spread: covariance of its free vector.
        rho: the viewer's roughness and its error; None where the fit was made in the viewer's own model, which
            leaves alpha to the first guess ρ/(2√2), or where the material has no roughness.
        nearest: known metals, nearest first.
        borrowed: n and k as known metals suggest them, for the channels whose own are not determined.
    """
    kind, viewers = fit.material.type, rho is None and fit.material.mirrors
    found = {each.name: measured(fit, spread, each) for each in reported_quantities(fit.material)}
    if {N.name, K.name} <= found.keys():
        blind = sees_f0_only(fit.residuals.coordinates)
        found |= (
            {each.name: unseen(fit, each) for each in (N, K)} if blind else paired(found[N.name], found[K.name], fit)
        )
    if viewers:
        found[ALPHA.name] = [Measured(found[ROUGHNESS.name][0].value / RHO_PER_ALPHA)]
    elif rho is not None:
        found[ROUGHNESS.name] = [of_viewer(rho)]
    errors = correlation(fit, spread, found)
    trusted = fit.solution.status == "converged"
    known = {key: [trusted and _is_determined(kind, key, each) for each in found[key]] for key in found}
    taken = None
    if isinstance(borrowed, Borrowed):
        taken = from_prior(borrowed, found, known)
        found |= with_prior(borrowed, found, known)
    return FittedMaterial(
        name=name,
        type=kind,
        **_each(found, lambda each: each.value),
        stderr=StandardErrors(**_each(found, lambda each: each.stderr)),
        interval95=Intervals(**_each(found, lambda each: each.interval)),
        determined=Determined(**_each(known, bool)),
        nearest=tuple(nearest),
        from_prior=taken,
        correlation=errors,
    )


def _is_determined(kind: str, key: str, number: Measured) -> bool:
    if number.stderr is None or number.interval is None:
        return False
    return is_determined(resolution(kind, key), number.value, number.interval)


def status_of(choices: Sequence[Choice], materials: Sequence[FittedMaterial]) -> Status:
    """stopped where a solver did not finish; not_determined where a material's essential numbers are not."""
    if any(choice.fit.solution.status == "stopped" for choice in choices):
        return "stopped"
    return "converged" if all(_is_usable(material) for material in materials) else "not_determined"


def _is_usable(material: FittedMaterial) -> bool:
    in_viewers_model = material.interval95.alpha is None
    verdicts: list[bool | None] = []
    for quantity in FITTABLE[material.type].essential:
        seen = ROUGHNESS if quantity == ALPHA and in_viewers_model else quantity
        verdict = getattr(material.determined, seen.name)
        verdicts += verdict if isinstance(verdict, tuple) else [verdict]
    return all(verdicts)


def describe(choice: Choice, material: FittedMaterial, seen: Seen, borrowed: Borrowed | TooFar | None = None) -> str:
    """A few sentences for a person: how the fit ended, and what the photographs do not determine."""
    fit = choice.fit
    steps = f"in {fit.solution.steps} steps"
    ending = f"converged {steps}" if fit.solution.status == "converged" else f"stopped {steps} without converging"
    sentences = [f"The fit {ending}.", *_on_the_type(choice), *verdicts(material, seen)]
    sentences += on_the_prior(material, borrowed)
    limit = 1.0 if KINDS[material.type].has_body else NO_METAL_BEYOND
    shining = [channel for channel, f0 in zip(CHANNELS, material.f0 or (), strict=False) if f0 > limit]
    if shining:
        sentences.append(
            f"F0 of {' and '.join(shining)} runs into 1: the object seems to send more light than it receives, so that"
            " exposure or scale of the environment is wrong, or the environment itself."
        )
    return " ".join(sentences)


def _on_the_type(choice: Choice) -> list[str]:
    """Which type was chosen and by how much, where there was a choice."""
    if choice.runner_up is None:
        return []
    kind, behind = choice.runner_up
    lead = f"is the type that explains the photographs best; {kind} comes next, its information criterion (BIC)"
    doubt = "" if behind > DECISIVE else f", less than the {DECISIVE:g} that would decide: give the type with --type"
    return [f"{choice.fit.material.type.capitalize()} {lead} is worse by {behind:.4g}{doubt}."]


def _each(found: Mapping[str, Sequence[T]], part: Callable[[T], object]) -> dict:
    """One part of every number by parameter; alpha and roughness have no channels."""
    parts = {key: [part(each) for each in measured] for key, measured in found.items()}
    return {key: each if len(each) == 3 else each[0] for key, each in parts.items()}
