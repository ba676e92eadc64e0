"""The reflectance curve F(θ) of a fitted material, what its errors allow, and its plot as SVG."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.html.svg import INK, inline_svg
from fit_material.fitter.least_squares.covariance import TWO_SIDED_95, Covariance, standard_errors
from fit_material.fitter.materials.coordinates import Coordinates
from fit_material.renderer.materials.catalogue import Metal
from fit_material.shaders.materials.types import Material
from fit_material.shaders.optics.fresnel import conductor

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CHANNELS = (("red", "#d1495b"), ("green", "#3a9a5c"), ("blue", "#3f7fcf"))

MaterialReflectance = Callable[[Material, Tensor], Tensor]


@dataclass(frozen=True)
class Curve:
    """Reflectance F against the angle of incidence, with its 95 % band, per channel.

    Attributes:
        theta: degrees, from 0 to 90, [t].
        value, low, high: F in [0, 1], [t, 3].
    """

    theta: Float[np.ndarray, " t"]
    value: Float[np.ndarray, "t 3"]
    low: Float[np.ndarray, "t 3"]
    high: Float[np.ndarray, "t 3"]


def reflectance_curve(
    reflectance: MaterialReflectance, coordinates: Coordinates, x: Tensor, spread: Covariance
) -> Curve:
    """F(θ) of a fitted material; its band is the value ± 1.96 standard errors, inside [0, 1].

    Args:
        reflectance: F(material, cos_d) that was fitted.
        coordinates, x, spread: the fit's free vector, what it stands for, and its covariance.
    """
    theta = torch.linspace(0, 90, 91, dtype=torch.float64)
    cos_d = torch.cos(torch.deg2rad(theta)).clamp_min(0)[:, None]

    def curve(free: Tensor) -> Tensor:
        return reflectance(coordinates.material(free), cos_d).expand(-1, 3).flatten()

    value = curve(x)
    half = TWO_SIDED_95 * standard_errors(curve, x, spread)
    low, high = (value - half).clamp_min(0), (value + half).clamp_max(1)
    return Curve(theta.numpy(), *(each.reshape(-1, 3).numpy() for each in (value, low, high)))


def reflectance_svg(curve: Curve, known: Sequence[tuple[str, Metal]], name: str) -> str:
    """The curve, a panel per channel, beside those of known metals (dashed), as an SVG to put into a page.

    Args:
        known: metals with the words that name them in the legend.
        name: keeps the ids of one page's figures apart; never shown.

    Returns:
        An `<svg>` element without addresses or fonts; lines and letters in `currentColor`.
    """
    return inline_svg(functools.partial(_panels, curve, known), name)


def _panels(curve: Curve, known: Sequence[tuple[str, Metal]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.5), layout="constrained")
    panels = figure.subplots(1, 3)
    for channel, axes in enumerate(panels):
        _draw_panel(axes, channel, curve, known)
    panels[0].set_ylabel("reflectance F")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    return figure


def _draw_panel(axes: Axes, channel: int, curve: Curve, known: Sequence[tuple[str, Metal]]) -> None:
    name, color = CHANNELS[channel]
    cos_d = torch.cos(torch.deg2rad(torch.from_numpy(curve.theta)))[:, None]
    band = (curve.low[:, channel], curve.high[:, channel])
    axes.fill_between(curve.theta, *band, color=color, alpha=0.22, linewidth=0, label="95 % band")
    axes.plot(curve.theta, curve.value[:, channel], color=color, linewidth=2, label="this fit")
    for dashes, (label, metal) in zip(((5, 2), (2, 2), (1, 3)), known, strict=False):
        known_curve = _metal_curve(cos_d, metal.n, metal.k)[:, channel]
        axes.plot(curve.theta, known_curve, color=INK, linewidth=1, dashes=dashes, label=label)
    axes.set(title=name, xlabel="angle of incidence θ (°)", xlim=(0, 90), xticks=(0, 30, 60, 90))
    axes.set_ylim(top=1.0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.15, color=INK, linewidth=0.6)
    axes.patch.set_visible(False)
    axes.figure.patch.set_visible(False)


def _metal_curve(cos_d: Float[torch.Tensor, "t 1"], n: Sequence[float], k: Sequence[float]) -> Float[np.ndarray, "t 3"]:
    """The exact F of a metal."""
    return conductor(cos_d, cos_d.new_tensor(n), cos_d.new_tensor(k)).numpy()
