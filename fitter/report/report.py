"""One self-contained page that shows what a fit found, how well, and what it took."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from markupsafe import Markup

from fit_material.fitter.html.templates import page_templates
from fit_material.fitter.report.image_quality import ViewPictures
from fit_material.fitter.report.outlier_map import ROBUST_AT, OutlierMap
from fit_material.fitter.report.pictures import (
    DEVIATION_RANGE,
    DIFFERENCE_COLORS,
    DIFFERENCE_RANGE,
    WEIGHT_COLORS,
    Rgba,
    colors_of,
    comparison_png,
    outlier_tiles,
    tiles,
)
from fit_material.fitter.report.reflectance_curve import CHANNELS, Curve, reflectance_svg
from fit_material.fitter.result.formatting import decimals
from fit_material.fitter.result.schema import FittedMaterial, FromPrior, PerParameter, Result
from fit_material.renderer.images.image_file import png
from fit_material.renderer.materials.catalogue import Metal, read_catalogue
from fit_material.shaders.materials.kinds import KINDS
from fit_material.shaders.materials.quantities import QUANTITIES

__all__ = ["ViewPictures", "comparison_png", "render_report"]

NEAREST_SHOWN = 3


@dataclass(frozen=True)
class Row:
    """One number of the parameter table, in words and digits."""

    parameter: str
    meaning: str
    channel: str
    color: str
    value: str
    interval: str
    determined: str
    origin: str


def render_report(
    result: Result,
    views: Sequence[ViewPictures],
    curves: Sequence[Curve | None],
    effects: Sequence[ViewPictures] = (),
    outliers: Sequence[OutlierMap] = (),
    *,
    maps: Sequence[tuple[str, Rgba, Rgba]] = (),
    command: str = "",
) -> str:
    """The report as one HTML page: pictures, curves and style inside, nothing loaded from elsewhere.

    Args:
        result: what was found; everything shown but the pictures comes from it.
        views: the pictures of each photograph, in the result's order, with its names.
        curves: the reflectance curve of each material, in the result's order; None for one that mirrors nothing.
        effects: of each effect the picture with it, as `photograph`, and without, as `fit`; named by it.
        outliers: what the fit does not explain, of each photograph.
        maps: of each material that has one its name, its colour map, and how many photographs see each texel.
        command: the command line that made the result, shown as it is; "" shows none.

    Returns:
        HTML text, UTF-8 when written.
    """
    page = page_templates()
    page.filters["number"] = _number
    page.filters["picture"] = _data_uri
    names = _distinct([view.name for view in views])
    known = {key: metal for metal in read_catalogue() for key in (metal.name, metal.title)}
    return page.get_template("report.html").render(
        result=result,
        headlines=[_headline(material, known) for material in result.materials],
        rows=tiles([replace(view, name=name) for view, name in zip(views, names, strict=True)]),
        effects=tiles(effects),
        quality=dict(zip(names, result.quality.photographs, strict=False)),
        cameras=dict(zip(names, result.cameras or (), strict=False)),
        difference_range=DIFFERENCE_RANGE,
        difference_colors=colors_of(DIFFERENCE_COLORS),
        outliers=list(zip(outlier_tiles(outliers), outliers, strict=True)),
        robust_at=ROBUST_AT,
        deviation_range=DEVIATION_RANGE,
        weight_colors=colors_of(WEIGHT_COLORS),
        tables=[(material, list(_rows(material))) for material in result.materials],
        curves=[
            (material.name, _plot(curve, material, known))
            for curve, material in zip(curves, result.materials, strict=True)
            if curve is not None
        ],
        maps=maps,
        time=_shares(result),
        command=command,
    )


def _distinct(names: Sequence[str]) -> list[str]:
    """The photographs' names, numbered where two are the same: files of two folders may share theirs."""
    if len(set(names)) == len(names):
        return list(names)
    return [f"{index}. {name}" for index, name in enumerate(names, 1)]


def _headline(material: FittedMaterial, known: dict[str, Metal]) -> str:
    """What one material is, as a sentence."""
    sentence = f"{material.name}: {KINDS[material.type].noun}"
    if material.nearest:
        near = [f"{_title(metal.name, known)} ({metal.distance:.2g} σ)" for metal in material.nearest[:2]]
        sentence += f", nearest to {', then '.join(near)}"
    if material.alpha is not None:
        sentence += f"; alpha {_with_error(material.alpha, material.stderr.alpha)}"
    return sentence + "."


def _title(name: str, known: dict[str, Metal]) -> str:
    return known[name].title if name in known else name


def _plot(curve: Curve, material: FittedMaterial, known: dict[str, Metal]) -> Markup:
    nearest = [
        (f"{known[near.name].title} ({near.distance:.2g} σ)", known[near.name])
        for near in material.nearest[:NEAREST_SHOWN]
        if near.name in known
    ]
    return Markup(reflectance_svg(curve, nearest, material.name))


def _rows(material: FittedMaterial) -> Iterator[Row]:
    """The numbers that the material has, in the order of `QUANTITIES`."""
    for parameter, quantity in QUANTITIES.items():
        value = getattr(material, parameter)
        if value is None:
            continue
        triple = isinstance(value, tuple)
        of_each = [_each(getattr(part, parameter, None), triple) for part in _with_uncertainty(material)]
        for channel, (number, error, interval, determined, taken) in enumerate(zip(*of_each, strict=True)):
            name, color = CHANNELS[channel] if triple else ("", "")
            yield Row(
                parameter if channel == 0 else "",
                quantity.meaning if channel == 0 else "",
                name,
                color,
                _with_error(number, error),
                _interval(interval, error),
                {True: "determined", False: "not determined", None: "–"}[determined],
                "from the catalogue" if taken else "",
            )


def _with_uncertainty(material: FittedMaterial) -> tuple[PerParameter[Any] | FromPrior | None, ...]:
    return material, material.stderr, material.interval95, material.determined, material.from_prior


def _each(value: Any, triple: bool) -> tuple[Any, ...]:
    """A parameter's values by channel; of a missing triple, three Nones."""
    if triple:
        return value if value is not None else (None,) * 3
    return (value,)


def _with_error(value: float, error: float | None) -> str:
    """`0.2310 ± 0.0062 (2.7 %)`: two digits of the error, and the value as far."""
    if not error:
        return _number(value)
    places = decimals(error)
    percent = f" ({100 * error / abs(value):.2g} %)" if value and error < 10 * abs(value) else ""
    return f"{value:.{places}f} ± {error:.{places}f}{percent}"


def _interval(interval: tuple[float, float] | None, error: float | None) -> str:
    if interval is None:
        return "–"
    places = decimals(error or interval[1] - interval[0])
    return f"{interval[0]:.{places}f} … {interval[1]:.{places}f}"


def _number(value: float | None, digits: int = 4, unit: str = "") -> str:
    """A number to read, or a dash where there is none."""
    return "–" if value is None else f"{value:.{digits}g}{unit}"


def _data_uri(picture: Rgba) -> str:
    return "data:image/png;base64," + base64.b64encode(png(picture)).decode("ascii")


def _shares(result: Result) -> list[tuple[str, float, float]]:
    """Where the time went: part, seconds, and its share of the bar, which sums to 1."""
    parts = result.time.model_dump(exclude={"total"})
    parts["the rest"] = max(result.time.total - sum(parts.values()), 0.0)
    total = sum(parts.values()) or 1.0
    return [(name, seconds, seconds / total) for name, seconds in parts.items()]
