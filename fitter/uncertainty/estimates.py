"""The numbers of a fit, each with its error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.estimation.viewer_roughness import ViewerRoughness
from fit_material.fitter.least_squares.covariance import TWO_SIDED_95, Covariance, standard_errors
from fit_material.fitter.options.fidelity import BLUR_RANGE, MICROFACET_RANGE
from fit_material.fitter.result.schema import CHANNELS
from fit_material.fitter.uncertainty.profile_likelihood import intervals
from fit_material.shaders.materials.kinds import KINDS, MaterialType
from fit_material.shaders.materials.quantities import ALPHA, QUANTITIES, ROUGHNESS, K, N, Quantity
from fit_material.shaders.materials.types import Material
from fit_material.shaders.optics import fresnel

RESOLVED = 1e-12  # of a value: float64 does not resolve smaller errors; a free number far beyond its domain has such
COVERED = 0.9  # of a domain: an interval that leaves out no more is the prior's


def reported_quantities(material: Material) -> tuple[Quantity, ...]:
    """Quantities that are reported of a material: those that make it up, those that follow, and its lobe's width."""
    width = () if material.width is None else (material.width.quantity,)
    return (*material.kind.stored, *material.kind.derived, *width)


def value_of(material: Material, quantity: Quantity) -> Float[Tensor, " c"]:
    """A quantity of a material, one number for each of its channels."""
    if material.width is not None and quantity == material.width.quantity:
        return material.width.value[None]
    return getattr(material, quantity.name).reshape(quantity.channels)


def name_of(quantity: Quantity, channel: int | None) -> str:
    """A quantity in words: "n of red", "alpha"; without a channel where it has none."""
    return quantity.name if channel is None else f"{quantity.name} of {CHANNELS[channel]}"


@dataclass(frozen=True)
class Measured:
    """A number with its standard error and 95 % interval, None where it has none."""

    value: float
    stderr: float | None = None
    interval: tuple[float, float] | None = None

    def within(self, low: float, high: float) -> Measured:
        """The number, known to lie in [low, high]: without an error, and with that interval, where no more is known.

        That is so where its own interval covers the domain but for a tenth, or its standard error all of it.
        """
        value = min(max(self.value, low), high)
        if self.stderr is None or self.interval is None:
            return Measured(value, None, (low, high))
        inside = max(self.interval[0], low), min(self.interval[1], high)
        if inside[1] - inside[0] >= COVERED * (high - low) or self.stderr >= high - low:
            return Measured(value, None, (low, high))
        return Measured(value, self.stderr, (min(inside[0], value), max(inside[1], value)))


def measured(fit: Fit, spread: Covariance, asked: Quantity) -> list[Measured]:
    """A quantity of a fit, per channel, with error and interval from the covariance of its free vector.

    A number that no free number moves, because these ran to the ends of their domains, has neither.
    """
    coordinates = fit.residuals.coordinates

    def quantity(x: Tensor) -> Tensor:
        return value_of(coordinates.material(x), asked)

    errors = standard_errors(quantity, fit.x, spread)
    lows, highs = intervals(fit, spread, quantity)
    rows = zip(quantity(fit.x).tolist(), errors.tolist(), lows.tolist(), highs.tolist(), strict=True)
    found = [
        Measured(value, error, (low, high))
        if error > RESOLVED * abs(value) and math.isfinite(error + low + high)
        else Measured(value)
        for value, error, low, high in rows
    ]
    if is_width(asked):
        found = [width_of(fit, each) for each in found]
    return [each.within(*domain) for each, domain in zip(found, _domains(fit, asked), strict=True)]


def is_width(quantity: Quantity) -> bool:
    """Whether a quantity is the width of a specular lobe."""
    return quantity in (ALPHA, ROUGHNESS)


def width_of(fit: Fit, number: Measured) -> Measured:
    """The lobe's width as its free number determines it, which knows nothing beyond the light table's span.

    Where the picture does not change with it, its interval is that of all that explain the photographs as well. One
    that fills the span, where it had to end, has a symmetric one instead.
    """
    if fit.alike is not None:
        low, high = fit.alike.span
        return Measured(number.value, (high - low) / math.sqrt(12), (min(low, number.value), max(high, number.value)))
    span = fit.residuals.coordinates.width
    assert span is not None
    if number.stderr is None or number.within(span.low, span.high).stderr is not None:
        return number
    half = TWO_SIDED_95 * number.stderr
    return replace(number, interval=(number.value - half, number.value + half))


def _domains(fit: Fit, quantity: Quantity) -> list[tuple[float, float]]:
    """Where a number lies without any photograph: n and k on the circle of their F0."""
    if is_width(quantity):
        return [BLUR_RANGE if quantity == ROUGHNESS else MICROFACET_RANGE]
    if quantity in (N, K):
        assert fit.material.f0 is not None
        limits = fresnel.index_limit(fit.material.f0).tolist()
        return [(1 / limit, limit) if quantity == N else (0.0, (limit - 1 / limit) / 2) for limit in limits]
    return [quantity.domain] * quantity.channels


def paired(n: Sequence[Measured], k: Sequence[Measured], fit: Fit) -> dict[str, list[Measured]]:
    """n and k, of which neither is narrower than its domain where the other is not: both run round one circle."""
    told = [a.stderr is not None and b.stderr is not None for a, b in zip(n, k, strict=True)]
    return {
        each.name: [own if known else bare for own, known, bare in zip(numbers, told, unseen(fit, each), strict=True)]
        for each, numbers in ((N, n), (K, k))
    }


def unseen(fit: Fit, quantity: Quantity) -> list[Measured]:
    """The same numbers of a model that cannot see them: the domain is all that is known."""
    values = value_of(fit.material, quantity).tolist()
    return [Measured(value).within(*domain) for value, domain in zip(values, _domains(fit, quantity), strict=True)]


def of_viewer(rho: ViewerRoughness) -> Measured:
    """The viewer's roughness."""
    if not math.isfinite(rho.stderr):
        return Measured(rho.rho).within(*BLUR_RANGE)
    half = TWO_SIDED_95 * rho.stderr
    return Measured(rho.rho, rho.stderr, (rho.rho - half, rho.rho + half)).within(*BLUR_RANGE)


def resolution(kind: MaterialType, key: str) -> tuple[float, float]:
    """`Quantity.resolved` by which a number counts as determined: 0.02 determines much of a metal's F0, and nothing of
    0.04."""
    return QUANTITIES[KINDS[kind].same_as.get(key, key)].resolved
