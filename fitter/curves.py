"""The reflectance curve F(θ) of a fitted material, what its errors allow, and its plot as SVG."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float

from fitter.catalogue import Metal
from fitter.result import FittedMaterial
from shaders.fresnel import conductor, extinction, index_limit, schlick

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DRAWS = 400

CHANNELS = (("red", "#d1495b"), ("green", "#3a9a5c"), ("blue", "#3f7fcf"))

INK = "#102030"
"""Stands for the page's text colour until the SVG is finished."""


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


def reflectance_curve(material: FittedMaterial, form: str) -> Curve:
    """F(θ) of a fitted material; its band holds 95 % of the curves that its standard errors allow.

    A metal under `form` "conductor" is drawn from `index_draws`; anything else is Schlick's curve, of which
    only the reflectance at normal incidence is uncertain.

    Args:
        form: the result's `model.reflectance`.
    """
    theta = np.linspace(0, 90, 91)
    cos_d = torch.cos(torch.deg2rad(torch.from_numpy(theta)))[:, None, None]
    rng = np.random.default_rng(0)
    if form == "conductor" and material.n is not None and material.k is not None:
        r, n = index_draws(material, rng)
        k = extinction(torch.from_numpy(r), torch.from_numpy(n))
        curves = conductor(cos_d, torch.from_numpy(n), k)
        value = _metal_curve(cos_d[:, 0], material.n, material.k)
    else:
        f0, error = _front_reflectance(material)
        curves = schlick(cos_d, torch.from_numpy(_normal(f0, error, rng)))
        value = schlick(cos_d[:, 0], torch.from_numpy(f0)).numpy()
    low, high = np.quantile(curves.numpy(), [0.025, 0.975], axis=1)
    return Curve(theta, value, low, high)


def index_draws(
    material: FittedMaterial, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "d 3"], Float[np.ndarray, "d 3"]]:
    """Draws of (F0, n) that a metal's standard errors allow; k follows by `extinction`.

    n and k alone would lose how strongly the data tie them to each other through F0. Their correlation is in
    the third standard error: with k = k(r, n), r = F0,

        σ_k² = k_r² σ_r² + k_n² σ_n² + 2 k_r k_n c σ_r σ_n

    gives c, the correlation of r and n. Where n has no standard error, the photographs say nothing about it
    beyond r: every n that r admits is drawn alike.

    Returns:
        r in (0, 1) and n within r's limits, DRAWS of each channel.
    """
    r0, sigma_r = _front_reflectance(material)
    r = _normal(r0, sigma_r, rng)
    limit = index_limit(torch.from_numpy(r)).numpy()
    n = np.empty_like(r)
    for channel in range(3):
        sigma_n, sigma_k = _error(material.stderr.n, channel), _error(material.stderr.k, channel)
        if material.n is None or sigma_n is None:
            n[:, channel] = rng.uniform(1 / limit[:, channel], limit[:, channel])
            continue
        center, sigma = material.n[channel], sigma_r[channel]
        c = _correlation(r0[channel], center, sigma, sigma_n, sigma_k)
        along = (r[:, channel] - r0[channel]) / sigma if sigma > 0 else rng.standard_normal(DRAWS)
        n[:, channel] = center + sigma_n * (c * along + np.sqrt(1 - c**2) * rng.standard_normal(DRAWS))
    return r, np.clip(n, 1 / limit, limit)


def reflectance_svg(curve: Curve, known: Sequence[tuple[str, Metal]], name: str) -> str:
    """The curve, a panel per channel, beside those of known metals (dashed), as an SVG to put into a page.

    Args:
        known: metals with the words that name them in the legend.
        name: keeps the ids of one page's figures apart; never shown.

    Returns:
        An `<svg>` element without addresses or fonts; lines and letters in `currentColor`.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    parts = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    inked = dict.fromkeys(parts, INK)
    with rc_context(rc={"svg.fonttype": "none", "svg.hashsalt": name, "font.size": 10, **inked}):
        figure = Figure(figsize=(10, 3.5), layout="constrained")
        panels = figure.subplots(1, 3)
        for channel, axes in enumerate(panels):
            _draw_panel(axes, channel, curve, known)
        panels[0].set_ylabel("reflectance F")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
        text = io.StringIO()
        FigureCanvasSVG(figure).print_svg(text)
    return _inline(text.getvalue())


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


def _inline(svg: str) -> str:
    """The `<svg>` element alone: no declarations, licence, addresses, or ids that could collide."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"| id="[\w.]+_\d+"|<!--.*?-->', "", svg, flags=re.DOTALL)
    svg = re.sub(r' width="[\d.]+pt" height="[\d.]+pt"', "", svg, count=1)
    return svg.replace(INK, "currentColor")


def _front_reflectance(
    material: FittedMaterial,
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """The reflectance at normal incidence and its standard error, 0 where there is none."""
    f0, errors = material.f0, material.stderr.f0
    if f0 is None:
        f0, errors = material.reflectance, material.stderr.reflectance
    if f0 is None:
        raise ValueError(f"{material.type} {material.name!r} has neither f0 nor reflectance")
    return np.array(f0, dtype=np.float64), np.array([_error(errors, channel) or 0.0 for channel in range(3)])


def _error(errors: Sequence[float | None] | None, channel: int) -> float | None:
    return None if errors is None else errors[channel]


def _normal(
    mean: Float[np.ndarray, " 3"], sigma: Float[np.ndarray, " 3"], rng: np.random.Generator
) -> Float[np.ndarray, "d 3"]:
    """Normal draws of a reflectance, kept inside (0, 1)."""
    return np.clip(mean + sigma * rng.standard_normal((DRAWS, 3)), 1e-6, 1 - 1e-6)


def _correlation(r: float, n: float, sigma_r: float, sigma_n: float, sigma_k: float | None) -> float:
    """c of `index_draws` in [-1, 1]; 0 where nothing tells it.

    From k² = (m - n)(n - 1/m), m = (1+√r)/(1-√r), hence m' = 1/(√r (1-√r)²):
    k_n = (m + 1/m - 2n)/2k and k_r = m' [(n - 1/m) + (m - n)/m²]/2k.
    """
    r = min(max(r, 1e-6), 1 - 1e-6)
    root = np.sqrt(r)
    m = (1 + root) / (1 - root)
    k = np.sqrt(max((m - n) * (n - 1 / m), 0.0))
    if sigma_k is None or k == 0:
        return 0.0
    k_n = (m + 1 / m - 2 * n) / (2 * k)
    k_r = ((n - 1 / m) + (m - n) / m**2) / (root * (1 - root) ** 2 * 2 * k)
    product = 2 * k_r * k_n * sigma_r * sigma_n
    if product == 0:
        return 0.0
    excess = sigma_k**2 - (k_r * sigma_r) ** 2 - (k_n * sigma_n) ** 2
    return float(np.clip(excess / product, -1, 1))


def _metal_curve(
    cos_d: Float[torch.Tensor, "t 1"], n: Sequence[float], k: Sequence[float]
) -> Float[np.ndarray, "t 3"]:
    """The exact F of a metal."""
    return conductor(cos_d, cos_d.new_tensor(n), cos_d.new_tensor(k)).numpy()
