"""n and k by known metals where the photographs do not determine them: the catalogue as a prior, the viewer's pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.least_squares.covariance import Covariance
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.metal_prior.borrowed import Borrowed, TooFar, Triple
from fit_material.fitter.options.fit_options import Prior
from fit_material.fitter.result.schema import FromPrior
from fit_material.fitter.uncertainty.estimates import Measured
from fit_material.renderer.materials.catalogue import read_catalogue
from fit_material.shaders.materials.quantities import INDEX, K, N

Numbers = Mapping[str, Sequence[Measured]]
Verdicts = Mapping[str, Sequence[bool]]


def borrow(fit: Fit, spread: Covariance, prior: Prior) -> Borrowed | TooFar | None:
    """n and k by known metals: as a prior, and in the viewer's model, which cannot see them, in any case.

    Args:
        fit, spread: of a material of any type, and the covariance of its free vector.
        prior: "catalogue" for the mixture of all its metals.
    """
    coordinates = fit.residuals.coordinates
    if not isinstance(coordinates, MetalCoordinates):
        return None
    found = _of_catalogue(fit, spread) if prior == "catalogue" else None
    if coordinates.tint is None or isinstance(found, Borrowed):
        return found
    return _of_nearest_color(fit.x[coordinates.slices["reflectivity"]], found)


def _of_catalogue(fit: Fit, spread: Covariance) -> Borrowed | TooFar:
    from fit_material.fitter.metal_prior.likelihood import likelihood
    from fit_material.fitter.metal_prior.mixture_posterior import catalogue_prior

    return catalogue_prior(likelihood(fit, spread))


def _of_nearest_color(reflectivity: Float[Tensor, "3"], refused: TooFar | None) -> Borrowed:
    """The pair at the fitted F0 with the tint of the metal that has the nearest F0."""
    from fit_material.fitter.metal_prior.catalogue_distribution import shape_of
    from fit_material.fitter.metal_prior.likelihood import indices

    f0, metals = torch.sigmoid(reflectivity), read_catalogue()
    distance = [float((shape_of(metal)[:3].sigmoid() - f0).norm()) for metal in metals]
    nearest = metals[distance.index(min(distance))]
    n, k = indices(torch.cat([reflectivity, shape_of(nearest)[3:]]))
    return Borrowed(((nearest.title, 1.0),), _bare(n), _bare(k), refused)


def _bare(values: Float[Tensor, "3"]) -> Triple:
    red, green, blue = (Measured(value) for value in values.tolist())
    return red, green, blue


def from_prior(borrowed: Borrowed, found: Numbers, known: Verdicts) -> FromPrior | None:
    """n and k that known metals replace: undetermined ones, and those that move with them by more than their error.

    Args:
        borrowed: n and k of known metals.
        found: the photographs' own numbers, by parameter.
        known: whether these are determined.

    Returns:
        None where the photographs determine all.
    """
    marks = {key: [_is_taken(borrowed, found, known, key, channel) for channel in range(3)] for key in INDEX}
    if not any(marks[N.name] + marks[K.name]):
        return None
    own = {key: [each.interval for each in found[key]] for key in INDEX}
    metals = [{"name": name, "share": share} for name, share in borrowed.metals]
    return FromPrior.model_validate({**marks, "metals": metals, "photographs95": own})


def with_prior(borrowed: Borrowed, found: Numbers, known: Verdicts) -> dict[str, list[Measured]]:
    """n and k, those of known metals in the undetermined channels; a determined one keeps its own error there."""
    numbers: dict[str, list[Measured]] = {}
    for key in INDEX:
        numbers[key] = list(found[key])
        for channel, new in enumerate(getattr(borrowed, key)):
            if _is_open(known, channel):
                taken, own = _is_taken(borrowed, found, known, key, channel), found[key][channel]
                numbers[key][channel] = new if taken else replace(own, value=new.value)
    return numbers


def _is_taken(borrowed: Borrowed, found: Numbers, known: Verdicts, key: str, channel: int) -> bool:
    own, new = found[key][channel], getattr(borrowed, key)[channel]
    if not known[key][channel] or own.stderr is None:
        return True
    return _is_open(known, channel) and abs(new.value - own.value) > own.stderr


def _is_open(known: Verdicts, channel: int) -> bool:
    """Whether n or k of a channel is not determined: then both are one pair at its F0, and go together."""
    return not (known[N.name][channel] and known[K.name][channel])
