"""Photograph, fit and difference side by side: what the report and the README show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, UInt8

from fit_material.fitter.fitted.color_texture import ColorMap, codes
from fit_material.fitter.report.image_quality import ViewPictures
from fit_material.renderer.images.display import tone_mapped, white_point
from fit_material.renderer.images.image_file import png

if TYPE_CHECKING:
    from fit_material.fitter.report.outlier_map import OutlierMap

DIFFERENCE_RANGE = 0.10
"""The relative difference at the ends of the colour scale."""

DIFFERENCE_COLORS = "RdBu_r"

SHOWN_WHITE = 98.0  # percentile; lamps may burn out, so that the rest of a metal is seen

LONGEST_SIDE = 800  # pixels; larger pictures are averaged down, so that the page stays a few MB

Rgba = UInt8[np.ndarray, "h w 4"]


DEVIATION_RANGE = 10.0
"""Standard deviations at the ends of the same scale, of the unexplained difference."""

WEIGHT_COLORS = "cividis"


@dataclass(frozen=True)
class Tiles:
    """One row of pictures, of equal size, transparent where there is nothing to show."""

    name: str
    photograph: Rgba
    fit: Rgba
    difference: Rgba


def tiles(views: Sequence[ViewPictures]) -> list[Tiles]:
    """Photograph, fit and difference of every view, all tone-mapped with one exposure.

    White is the percentile SHOWN_WHITE of all masked photographs together. The difference is (Y_fit - Y)/Y
    of the luminances Y, on a diverging scale of ±`DIFFERENCE_RANGE`; a Y below 1 % of white counts as that
    1 %.
    """
    small = [_shrunk(view) for view in views]
    masked = [view.photograph[view.mask] for view in small]
    white = white_point(np.concatenate(masked), SHOWN_WHITE) if masked else 1.0
    return [_tiles(view, white) for view in small]


def outlier_tiles(maps: Sequence[OutlierMap]) -> list[Tiles]:
    """Of each photograph itself, how the fit deviates from it, and what its pixels counted, as `difference`."""
    from matplotlib import colormaps

    found = []
    for each in maps:
        masked = each.photograph[each.mask]
        shown = _rgba(tone_mapped(each.photograph, white_point(masked, SHOWN_WHITE)), each.mask)
        deviation = colormaps[DIFFERENCE_COLORS](0.5 + 0.5 * each.deviation / DEVIATION_RANGE)[..., :3]
        weight = colormaps[WEIGHT_COLORS](each.weight)[..., :3]
        found.append(Tiles(each.name, shown, _rgba(deviation, each.mask), _rgba(weight, each.mask)))
    return found


def comparison_png(views: Sequence[ViewPictures], gap: int = 8) -> bytes:
    """Photograph | fit | difference, one row for each view, as one PNG; transparent gaps of `gap` pixels."""
    rows = [_beside([row.photograph, row.fit, row.difference], gap) for row in tiles(views)]
    width = max(row.shape[1] for row in rows)
    padded = [np.pad(row, ((0, gap), (0, width - row.shape[1]), (0, 0))) for row in rows]
    return png(np.concatenate(padded)[:-gap])


def colors_of(scale: str, count: int = 11) -> list[str]:
    """A colour scale from its low to its high end as `#rrggbb`."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colormaps[scale](x)) for x in np.linspace(0, 1, count)]


def _tiles(view: ViewPictures, white: float) -> Tiles:
    shown = view.mask | view.photograph.any(axis=-1)  # a photograph's own background is worth seeing
    return Tiles(
        view.name,
        photograph=_rgba(tone_mapped(view.photograph, white), shown),
        fit=_rgba(tone_mapped(np.where(view.mask[..., None], view.fit, 0), white), view.mask),
        difference=_rgba(_difference(view, white), view.mask),
    )


def _difference(view: ViewPictures, white: float) -> Float[np.ndarray, "h w 3"]:
    from matplotlib import colormaps

    weights = np.array([0.2126, 0.7152, 0.0722])  # luminance of Rec. 709
    photograph, fit = view.photograph @ weights, np.where(view.mask, view.fit @ weights, 0)
    relative = (fit - photograph) / np.maximum(photograph, 0.01 * white)
    return colormaps[DIFFERENCE_COLORS](0.5 + 0.5 * relative / DIFFERENCE_RANGE)[..., :3]


def _rgba(color: Float[np.ndarray, "h w 3"], shown: Bool[np.ndarray, "h w"]) -> Rgba:
    rgba = np.concatenate([color, np.ones_like(color[..., :1])], axis=-1) * shown[..., None]
    return np.round(255 * rgba).astype(np.uint8)


def _beside(pictures: Sequence[Rgba], gap: int) -> Rgba:
    """Pictures of equal height in a row, `gap` transparent pixels between them."""
    columns = [np.pad(picture, ((0, 0), (0, gap), (0, 0))) for picture in pictures]
    return np.concatenate(columns, axis=1)[:, :-gap]


def _shrunk(view: ViewPictures) -> ViewPictures:
    """The view averaged in linear light over squares, until its longer side is at most LONGEST_SIDE."""
    step = -(-max(view.mask.shape) // LONGEST_SIDE)
    if step == 1:
        return view
    height, width = (side // step for side in view.mask.shape)

    def squares(picture: np.ndarray) -> np.ndarray:
        inside = picture[: height * step, : width * step]
        return inside.reshape(height, step, width, step, -1).swapaxes(1, 2).reshape(height, width, step**2, -1)

    return ViewPictures(
        view.name,
        photograph=squares(view.photograph).mean(axis=2),
        fit=squares(view.fit).mean(axis=2),
        mask=np.all(squares(view.mask), axis=(2, 3)),
    )


def map_pictures(found: ColorMap) -> tuple[Rgba, Rgba]:
    """The map, and how many photographs see each texel, for people: at most `LONGEST_SIDE` texels along a side."""
    step = -(-max(found.photographs.shape) // LONGEST_SIDE)
    color, seen = codes(found.color[::step, ::step]), found.photographs[::step, ::step]
    grey = np.round(255 * seen / max(1, seen.max())).astype(np.uint8)[..., None].repeat(3, -1)
    whole = np.full_like(grey[..., :1], 255)
    return np.concatenate([color, whole], -1), np.concatenate([grey, whole], -1)
