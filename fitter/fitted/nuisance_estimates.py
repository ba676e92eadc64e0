"""What was found beside the material: exposures, white balances, the environment's scale, with their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.least_squares.covariance import TWO_SIDED_95, Covariance, is_determined
from fit_material.fitter.least_squares.nuisances import Nuisances, Unknown
from fit_material.fitter.result.schema import CHANNELS, Nuisance
from fit_material.fitter.uncertainty.profile_likelihood import intervals

FACTOR_RESOLVED = 0.05  # relative half width of a 95 % interval below which a factor counts as determined
ROTATION_RESOLVED = 1.0  # the same of the environment's rotation, in degrees
WORDS = {
    "exposure": "exposure",
    "white_balance": "white balance",
    "scale": "scale of the environment",
    "rotation": "rotation of the environment",
}


@dataclass(frozen=True)
class NuisanceEstimates:
    """The unknown factors of a scene as its materials' fits found them, each by the fit that knows it best.

    Attributes:
        nuisances: which there are, with what was known before.
        z: their logarithms.
        records: for `result.json`.
    """

    nuisances: Nuisances
    z: Float[Tensor, " z"]
    records: tuple[Nuisance, ...]

    @property
    def factors(self) -> Float[Tensor, "v 3"]:
        """Pixel over what was read as radiance."""
        return self.nuisances.factors(self.z)

    @property
    def exposures(self) -> Float[Tensor, " v"]:
        """The part of `factors` that is exposure."""
        own = torch.tensor([each.key == "exposure" for each in self.nuisances.unknowns])
        return self.nuisances.factors(self.z * own)[:, 1]

    @property
    def told(self) -> list[str]:
        """All of it, and where it comes from, in sentences."""
        open_, known = ([each for each in self.records if each.determined is kind] for kind in (False, True))
        sentences = []
        if known:
            sentences.append(f"Fitted beside the material: {_listed(known)}.")
        if open_:
            why = (
                "the surroundings behind the object are not enough"
                if any(each.by_surroundings for each in open_)
                else "no photograph shows the environment behind the object"
            )
            sentences.append(f"Fitted, but not determined by these photographs: {_listed(open_)}; {why}.")
        return sentences


def nuisance_estimates(fits: Sequence[tuple[Fit, Covariance]], names: Sequence[str]) -> NuisanceEstimates | None:
    """What was fitted beside the materials; None where nothing was.

    Args:
        fits: of all materials, with the covariances of their free vectors.
        names: the photographs'.
    """
    gains = fits[0][0].residuals.gains
    if gains is None:
        return None
    unknowns = gains.nuisances.unknowns
    chosen = [min(fits, key=lambda each: _error(*each, index)) for index in range(len(unknowns))]
    z = torch.stack([fit.residuals.nuisance_part(fit.x)[index] for index, (fit, _) in enumerate(chosen)])
    records = [_record(*each, index, names) for index, each in enumerate(chosen)]
    return NuisanceEstimates(gains.nuisances, z, tuple(records))


def guessed(fit: Fit, spread: Covariance) -> tuple[str, ...]:
    """What was fitted beside a material and is not determined, in words."""
    gains = fit.residuals.gains
    if gains is None:
        return ()
    names = ("",) * gains.nuisances.photographs
    factors = [index for index, each in enumerate(gains.nuisances.unknowns) if each.key != "rotation"]
    found = (_record(fit, spread, index, names) for index in factors)
    return tuple(dict.fromkeys(WORDS[each.name] for each in found if not each.determined))


def _error(fit: Fit, spread: Covariance, index: int) -> float:
    """Standard deviation of one logarithm."""
    place = fit.residuals.coordinates.size + index
    return float(spread.covariance[place, place].sqrt())


def _record(fit: Fit, spread: Covariance, index: int, names: Sequence[str]) -> Nuisance:
    gains = fit.residuals.gains
    assert gains is not None
    nuisances, unknown = gains.nuisances, gains.nuisances.unknowns[index]

    def quantity(x: Tensor) -> Tensor:
        return unknown.value(fit.residuals.nuisance_part(x)[index : index + 1])

    low, high = (float(end) for end in intervals(fit, spread, quantity))
    value = float(quantity(fit.x))
    width = float(torch.linalg.inv(nuisances.root.T @ nuisances.root).diagonal()[index].sqrt())
    before = nuisances.mean[index] + TWO_SIDED_95 * width * torch.tensor([-1.0, 1.0], dtype=torch.float64)
    low, high = min(low, value), max(high, value)
    return Nuisance(
        name=unknown.key,
        photograph=None if unknown.photograph is None else names[unknown.photograph],
        channel=None if unknown.channel is None else CHANNELS[unknown.channel],
        value=value,
        stderr=_error(fit, spread, index) * (1 if unknown.key == "rotation" else value),
        interval95=(low, high),
        determined=fit.solution.status == "converged" and is_determined(_resolution(unknown), value, (low, high)),
        before95=tuple(unknown.value(before).tolist()),
        by_surroundings=bool(nuisances.told[index]),
    )


def _resolution(unknown: Unknown) -> tuple[float, float]:
    """Relative and absolute half width of an interval that counts as determined."""
    return (0.0, ROTATION_RESOLVED) if unknown.key == "rotation" else (FACTOR_RESOLVED, 0.0)


def turned(lighting: Lighting, fit: Fit) -> Lighting:
    """The light with the environment rotated as fitted, where that was unknown."""
    gains = fit.residuals.gains
    return lighting if gains is None or gains.nuisances.turn is None else lighting.turned(fit.residuals.rotation(fit.x))


def _listed(records: Sequence[Nuisance]) -> str:
    """`exposure of view_0 0.0112 ± 0.5 % (by what is seen behind the object)`; of many, the first few are named."""
    told = [_words(each) for each in records[:4]]
    if len(records) > 4:
        told.append(f"and {len(records) - 4} more in result.json")
    return ", ".join(told)


def _words(record: Nuisance) -> str:
    which = f" of {record.photograph}" if record.photograph else ""
    channel = f", {record.channel}," if record.channel else ""
    if not record.determined:
        return f"{WORDS[record.name]}{which}{channel} in {record.interval95[0]:.3g}…{record.interval95[1]:.3g}"
    value = f"{record.value:.4g} ± {100 * record.stderr / record.value:.2g} %"
    if record.name == "rotation":
        value = f"{record.value:.2f} ± {record.stderr:.2g} degrees"
    return f"{WORDS[record.name]}{which}{channel} {value}" + (
        " (seen behind the object)" if record.by_surroundings else ""
    )
