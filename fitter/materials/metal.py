"""How a metal is fitted: its free vector, where a search for it begins, and which of its numbers count."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import softplus

from fit_material.fitter.forward.pixel_model import PixelModel
from fit_material.fitter.materials.coordinates import REACH, Coordinates, WidthInterval
from fit_material.fitter.materials.fittable import Fittable
from fit_material.fitter.materials.linear_starts import share, widths
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.renderer.materials.catalogue import DARKEST_METAL, metal, read_catalogue
from fit_material.shaders.materials.kinds import METAL as KIND
from fit_material.shaders.materials.metal import Metal
from fit_material.shaders.materials.quantities import ALPHA, F0, K, N
from fit_material.shaders.materials.widths import Width
from fit_material.shaders.optics import fresnel

TINT_WIDTH = 1.5  # of artanh(log n / log m); the catalogue's metals lie within ±1
TINTS = (-1.0, -0.5, 0.0, 0.5)  # where metals lie, half the prior's width apart
_MOST_REFLECTIVE = 9.2  # F0 = 0.9999, which no metal exceeds; n and k stay below 1e5 where a fit runs into it


@dataclass(frozen=True)
class MetalCoordinates(Coordinates[Metal]):
    """The free vector of a metal: reflectivity per channel, tint per channel, width.

        F0 = sigmoid(reflectivity),   n = m^tanh(tint),   m = (1+√F0)/(1-√F0)

    A material of reflectivity F0 has its n in [1/m, m] and every n there belongs to one k (`fresnel.extinction`),
    so that the free vector reaches every metal and nothing else. This is Gulbrandsen's pair of reflectivity and
    edge tint, with the tint measured in log n: real metals, whose edge tints crowd within 0.95…1, spread out.

    Attributes:
        width: the interval of alpha or ρ.
        tint: fixed where the reflectance in use cannot see them; None where they are unknowns.
    """

    width: WidthInterval
    tint: Float[Tensor, "3"] | None = None

    @property
    def sizes(self) -> Mapping[str, int]:
        return {"reflectivity": 3, **({"tint": 3} if self.tint is None else {}), "width": 1}

    @property
    def shape(self) -> slice:
        """Where the free numbers of n and k lie."""
        return slice(0, self.slices["width"].start)

    @property
    def sees_f0_only(self) -> bool:
        return self.tint is not None

    def material(self, x: Float[Tensor, " x"]) -> Metal:
        """The metal of a free vector.

        k² = (m - n)(n - 1/m) is written with n = m^t as n² (m^(1-t) - 1)(1 - m^-(1+t)), 1 ± t = 2 sigmoid(±2·tint):
        so k and its derivative keep their digits where n comes to its limits. `REACH` ends what is distinguishable.
        """
        reflectivity = x[self.slices["reflectivity"]].clamp(-REACH, _MOST_REFLECTIVE)
        tint = (x[self.slices["tint"]] if self.tint is None else self.tint.to(x)).clamp(-REACH, REACH)
        log_limit = 2 * torch.log1p(torch.sigmoid(reflectivity).sqrt()) + softplus(reflectivity)
        n = (log_limit * torch.tanh(tint)).exp()
        above, below = (2 * log_limit * torch.sigmoid(side) for side in (-2 * tint, 2 * tint))
        k = n * (torch.expm1(above) * -torch.expm1(-below)).sqrt()
        return Metal(n, k, self.width.width(x[self.slices["width"]]))

    def free(self, material: Metal) -> Float[Tensor, " x"]:
        tint = [tint_of(material.n, material.k)] if self.tint is None else []
        return torch.cat([_reflectivity_of(material.n, material.k), *tint, self.width.free_width(material.width)])

    def alternative_starts(self, x: Float[Tensor, " x"]) -> list[Float[Tensor, " x"]]:
        """The same F0 and width with other n: curves of equal F0 cross, and the sum may have two valleys."""
        if self.tint is not None:
            return []
        place = self.slices["tint"]
        return [torch.cat([x[: place.start], torch.full_like(x[place], tint), x[place.stop :]]) for tint in TINTS]

    def prior(self, x: Float[Tensor, " x"]) -> Float[Tensor, " q"]:
        """Normal about n = 1 with `TINT_WIDTH`, wider than all metals.

        It moves nothing that the photographs determine; where they do not, it keeps the fit from a mirror of n = 100
        that looks the same.
        """
        return x[self.slices["tint"]] / TINT_WIDTH if self.tint is None else x[:0]


def tint_of(n: Float[Tensor, "3"], k: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """artanh(log n / log m): where n lies between its limits 1/m and m for the reflectivity of (n, k).

        artanh(log n / log m) = ½ log[log(nm) / log(m/n)],   log(m/n) = log(1 + k²/(n(n - 1/m)))

    and alike log(nm) where n < 1: the rest of a limit is determined by k, which the difference of the logarithms would
    lose. Within ±`REACH`, which stand for k = 0; 0 for the air's own n = 1, k = 0.
    """
    limit = fresnel.index_limit(fresnel.normal_reflectance(n, k))
    upper = torch.where(n >= 1, n, 1 / n)  # by n and 1/n the same, with the signs exchanged
    extinct = (k / n.clamp_max(1)) ** 2
    near = torch.log1p(extinct / (upper * (upper - 1 / limit)))
    tint = 0.5 * ((limit.log() + upper.log()) / near).log().clamp(0, 2 * REACH)
    return torch.where(n >= 1, tint, -tint).nan_to_num(0.0)


def _reflectivity_of(n: Float[Tensor, "3"], k: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """logit F0 = log[((n-1)² + k²)/4n], in which 1 - F0 is not lost where F0 → 1."""
    return (((n - 1) ** 2 + k**2) / (4 * n)).log().clamp(-REACH, REACH)


def start(model: PixelModel, photograph: Float[Tensor, "p 3"], weight: Float[Tensor, "p 3"]) -> Metal:
    """A metal of flat reflectance, whose F0 is then a linear fit.

        F0 = Σ w² m y / Σ w² m²,   m the picture of a perfect mirror of that roughness

    Returns:
        that roughness, that F0 within [0.05, 0.95], and n = 1, the middle of what F0 admits: no metal in particular.
    """
    assert model.table is not None
    mirror = model.table.mean(torch.float64)[:, :, 0]  # the first Chebyshev polynomial is 1: light under F = 1
    f0 = share(mirror, photograph, weight).clamp(0.05, 0.95)
    error = ((f0[:, None] * mirror - photograph) * weight).abs().mean((1, 2))
    best = int(error.argmin())
    n = torch.ones_like(f0[best])
    return Metal(n, fresnel.extinction(f0[best], n), widths(model)[best])


def half_reflecting(width: Width) -> Metal:
    """A metal that reflects half of the light."""
    half, one = torch.full((3,), 0.5).double(), torch.ones(3).double()
    return Metal(one, fresnel.extinction(half, one), width)


def coordinates(start: Metal, width: WidthInterval, fidelity: Fidelity) -> MetalCoordinates:
    """The unknowns of a metal: tint among them where the reflectance in use can see it."""
    return MetalCoordinates(width, None if fidelity.reflectance == "conductor" else _known_tint(start))


def _known_tint(start: Metal) -> Float[Tensor, "3"]:
    """For what sees F0 alone: the tint of the catalogue's metal with the nearest colour."""
    known = [(torch.tensor(m.n, dtype=torch.float64), torch.tensor(m.k, dtype=torch.float64)) for m in read_catalogue()]
    distance = [float((fresnel.normal_reflectance(n, k) - start.f0).norm()) for n, k in known]
    return tint_of(*known[min(range(len(known)), key=distance.__getitem__)])


def examples(width: Width) -> dict[str, Metal]:
    """Gold."""
    gold = metal("Au")
    n, k = (torch.tensor(each, dtype=torch.float64) for each in (gold.n, gold.k))
    return {f"gold of alpha {width.value:g}": Metal(n, k, width)}


METAL = Fittable(
    KIND,
    coordinates,
    start,
    half_reflecting,
    examples,
    essential=(F0, ALPHA),
    decisive=(N, K, ALPHA),
    foreseen=MetalCoordinates,
    darkest=(F0, DARKEST_METAL),
)
