"""How the errors of a material's numbers go together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.least_squares.covariance import Covariance
from fit_material.fitter.least_squares.jacobian import jacobian
from fit_material.fitter.result.schema import Correlation
from fit_material.fitter.uncertainty.estimates import Measured, name_of, reported_quantities, value_of


def correlation(fit: Fit, spread: Covariance, found: Mapping[str, Sequence[Measured]]) -> Correlation | None:
    """Correlation coefficients C_ij/√(C_ii C_jj) of all numbers that have standard errors, to first order.

    Args:
        fit: what was found.
        spread: covariance of its free vector.
        found: by the keys of `result.json`: which numbers have errors.

    Returns:
        None where fewer than two have.
    """
    coordinates, material = fit.residuals.coordinates, fit.material
    names, gradients = [], []
    for quantity in reported_quantities(material):
        if quantity.name in material.kind.same_as:
            continue
        gradient = jacobian(lambda x, of=quantity: value_of(coordinates.material(x), of), fit.x)
        numbers = found[quantity.name]
        for channel, number in enumerate(numbers):
            if number.stderr is not None:
                names.append(name_of(quantity, channel if len(numbers) == 3 else None))
                gradients.append(gradient[channel])
    if len(names) < 2:
        return None
    rows = torch.stack(gradients)
    covariance = rows @ spread.covariance @ rows.T
    sigma = covariance.diagonal().clamp_min(torch.finfo(covariance.dtype).tiny).sqrt()
    coefficients = (covariance / sigma / sigma[:, None]).clamp(-1, 1)
    coefficients = ((coefficients + coefficients.T) / 2).fill_diagonal_(1.0)
    return Correlation(numbers=tuple(names), coefficients=tuple(map(tuple, coefficients.tolist())))
