"""A metal's GGX lobe by three programs in float32, and by the same formulas at fifty digits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np
import torch
from torch import Tensor

from fit_material.renderer.mitsuba.conversion import mitsuba
from fit_material.shaders.optics import fresnel, microfacets

RIGHT = 1e-3  # relative: what float32 may lose in a lobe a thousandth wide and still be right
SMALL = 1e-6  # of 1/α², the lobe's size: less is none


@dataclass(frozen=True)
class Place:
    """A metal, seen and lit in one plane: angles to the normal in radians, on opposite sides."""

    name: str
    n: float
    k: float
    alpha: float
    view: float
    light: float

    @property
    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """v and l, as float32 holds them."""
        v = np.array([math.sin(self.view), 0, math.cos(self.view)], np.float32)
        return v, np.array([-math.sin(self.light), 0, math.cos(self.light)], np.float32)


def _degrees(*angles: float) -> tuple[float, ...]:
    return tuple(map(math.radians, angles))


PLACES = (
    Place("gold, alpha 0.2, 45°", 0.18, 3.4, 0.2, *_degrees(45, 45)),
    Place("gold, alpha 1", 0.18, 3.4, 1.0, *_degrees(30, 60)),
    Place("gold, alpha 1e-3, its highlight", 0.18, 3.4, 1e-3, *_degrees(45, 45)),
    Place("gold, alpha 1e-3, half a width beside it", 0.18, 3.4, 1e-3, *_degrees(45, 45.05)),
    Place("gold, alpha 1e-3, far off", 0.18, 3.4, 1e-3, *_degrees(45, 10)),
    Place("gold, alpha 0.2, straight", 0.18, 3.4, 0.2, 0.0, 0.0),
    Place("gold, alpha 0.2, view at 89.9°", 0.18, 3.4, 0.2, *_degrees(89.9, 60)),
    Place("gold, alpha 0.2, view and light at 89.99°", 0.18, 3.4, 0.2, *_degrees(89.99, 89.99)),
    Place("gold, alpha 0.05, view at 89.9°, light at 89.9°", 0.18, 3.4, 0.05, *_degrees(89.9, 89.9)),
    Place("silver, n 1e-4, 45°", 1e-4, 4.0, 0.2, *_degrees(45, 45)),
    Place("silver, n 1e-4, 89°", 1e-4, 4.0, 0.2, *_degrees(89, 89)),
    Place("n 1.5, k 0, 45°", 1.5, 0.0, 0.2, *_degrees(45, 45)),
    Place("n 1.5, k 0, 89.9°", 1.5, 0.0, 0.2, *_degrees(89.9, 89.9)),
    Place("n 1.001, k 0, straight", 1.001, 0.0, 0.2, 0.0, 0.0),
    Place("n 1, k 0: air", 1.0, 0.0, 0.2, *_degrees(45, 45)),
    Place("n 0.6, k 0, 60°: total reflection", 0.6, 0.0, 0.2, *_degrees(60, 60)),
    Place("n 10, k 10", 10.0, 10.0, 0.2, *_degrees(45, 45)),
    Place("n 10, k 100", 10.0, 100.0, 0.2, *_degrees(45, 45)),
    Place("n 1000, k 1000", 1e3, 1e3, 0.2, *_degrees(45, 45)),
)


@dataclass(frozen=True)
class Judged:
    """Relative error of value and slopes; infinite or NaN where they are not finite."""

    value: float
    slope: float

    @property
    def right(self) -> bool:
        return self.value <= RIGHT and self.slope <= RIGHT

    def __str__(self) -> str:
        return ", ".join(
            f"{error:.0e}" if math.isfinite(error) else "**not finite**" for error in (self.value, self.slope)
        )


Answer = tuple[float, tuple[float, float, float]]
"""A value, and its slopes by n, k, alpha."""


def compared() -> Iterator[tuple[Judged, Judged, Judged]]:
    """Ours, Mitsuba's and the textbook's at each place."""
    for place in PLACES:
        exact = reference(place)
        ours, mitsubas, plain = (_judged(find(place), exact, place) for find in (by_us, by_mitsuba, by_textbook))
        yield ours, mitsubas, plain


def _judged(found: Answer, exact: Answer, place: Place) -> Judged:
    least = SMALL / place.alpha**2
    steepest = max(*map(abs, exact[1]), least)
    slopes = [abs(a - b) / steepest for a, b in zip(found[1], exact[1], strict=True)]
    worst = math.nan if any(map(math.isnan, slopes)) else max(slopes)
    return Judged(abs(found[0] - exact[0]) / max(abs(exact[0]), least), worst)


def reference(place: Place) -> Answer:
    """The formulas at 50 digits, in the directions that float32 holds; slopes by differences of 1e-15."""
    towards = [[mp.mpf(float(x)) for x in each] for each in place.directions]
    with mp.workdps(50):
        v, light = ([x / mp.sqrt(sum(y * y for y in each)) for x in each] for each in towards)
        half = [a + b for a, b in zip(v, light, strict=True)]
        half = [x / mp.sqrt(sum(y * y for y in half)) for x in half]
        cos_d = sum(a * b for a, b in zip(v, half, strict=True))

        def value(n: Any, k: Any, alpha: Any) -> Any:
            eta2 = mp.mpc(n, k) ** 2
            w = mp.sqrt(eta2 - (1 - cos_d**2))
            s, p = (cos_d - w) / (cos_d + w), (eta2 * cos_d - w) / (eta2 * cos_d + w)
            density = alpha**2 / (mp.pi * (half[2] ** 2 * alpha**2 + 1 - half[2] ** 2) ** 2)
            masked = [2 / (1 + mp.sqrt(1 + alpha**2 * (1 / c**2 - 1))) for c in (v[2], light[2])]
            return (abs(s) ** 2 + abs(p) ** 2) / 2 * density * masked[0] * masked[1] / (4 * v[2])

        at = [mp.mpf(float(np.float32(x))) for x in (place.n, place.k, place.alpha)]
        slopes = [
            mp.diff(lambda x, i=i: value(*(x if i == j else y for j, y in enumerate(at))), at[i], direction=1)
            for i in range(3)
        ]
        return float(value(*at)), tuple(map(float, slopes))  # type: ignore[return-value]


def _by_torch(place: Place, value: Callable[..., Tensor]) -> Answer:
    unknowns = [torch.tensor(x, dtype=torch.float32, requires_grad=True) for x in (place.n, place.k, place.alpha)]
    v, light = (torch.from_numpy(each) for each in place.directions)
    half = torch.nn.functional.normalize(v + light, dim=0)
    found = value(v, light, half, *unknowns)
    slopes = torch.autograd.grad(found, unknowns)
    return found.item(), tuple(slope.item() for slope in slopes)  # type: ignore[return-value]


def by_us(place: Place) -> Answer:
    """`shaders`."""

    def value(v: Tensor, light: Tensor, half: Tensor, n: Tensor, k: Tensor, alpha: Tensor) -> Tensor:
        sin2_h = half[0] ** 2 + half[1] ** 2
        return fresnel.conductor((v @ half).clamp(0, 1), n, k) * microfacets.reflected(
            v[2], light[2], half[2], alpha, "ggx", sin2_h
        )

    return _by_torch(place, value)


def by_textbook(place: Place) -> Answer:
    """PBRT's and Lagarde's formulas, as one writes them down."""

    def value(v: Tensor, light: Tensor, half: Tensor, n: Tensor, k: Tensor, alpha: Tensor) -> Tensor:
        c = v @ half
        s2 = 1 - c**2
        t0 = n**2 - k**2 - s2
        size = (t0**2 + 4 * n**2 * k**2).sqrt()
        t2 = 2 * (0.5 * (size + t0)).sqrt() * c
        r_s = (size + c**2 - t2) / (size + c**2 + t2)
        r_p = r_s * (c**2 * size + s2**2 - t2 * s2) / (c**2 * size + s2**2 + t2 * s2)
        density = alpha**2 / (math.pi * ((alpha**2 - 1) * half[2] ** 2 + 1) ** 2)
        masked = [2 * x / (x + (alpha**2 + (1 - alpha**2) * x**2).sqrt()) for x in (v[2], light[2])]
        return (r_s + r_p) / 2 * density * masked[0] * masked[1] / (4 * v[2])

    return _by_torch(place, value)


def by_mitsuba(place: Place) -> Answer:
    """`roughconductor`, which includes the cosine of the light."""
    import drjit as dr

    mi = mitsuba("llvm_ad_rgb")
    v, light = (mi.Vector3f(*map(float, each)) for each in place.directions)
    slopes, found = [], math.nan
    for key in ("eta.value", "k.value", "alpha.value"):
        index = {"eta": place.n, "k": place.k}
        bsdf = mi.load_dict({"type": "roughconductor", "alpha": place.alpha, "distribution": "ggx", **_grey(index)})
        parameters = mi.traverse(bsdf)
        dr.enable_grad(parameters[key])
        parameters.update()
        interaction = dr.zeros(mi.SurfaceInteraction3f)
        interaction.wi = v
        value = bsdf.eval(mi.BSDFContext(), interaction, light)[0]
        dr.set_grad(parameters[key], 1.0)
        found, slope = float(dr.detach(value)[0]), dr.forward_to(value)
        slopes.append(float(slope[0]))
    return found, tuple(slopes)  # type: ignore[return-value]


def _grey(index: dict[str, float]) -> dict[str, Any]:
    return {key: {"type": "rgb", "value": [value] * 3} for key, value in index.items()}
