"""The arguments of `fit-material probe`; heavy imports are late."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fit_material.fitter.command_line.output import say
from fit_material.renderer.errors.input_error import InputError


def probe(
    balls: Annotated[list[Path], typer.Argument(metavar="BALL...", help="One photograph, or several exposures.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="MAP.exr", help="Where the map goes.")],
    circle: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y RADIUS", help="The ball's outline in pixels from the upper left; else it is found."),
    ] = None,
    metal: Annotated[str, typer.Option(help="Of the ball's surface, by symbol or name.")] = "Cr",
    encoding: Annotated[str | None, typer.Option(help='Of the photographs: srgb, linear, "gamma:2.2", fit.')] = None,
    exposure: Annotated[
        str | None, typer.Option(metavar="NUMBER|exif", help="Of a single photograph; 1 where left out.")
    ] = None,
    height: Annotated[int, typer.Option(help="Rows of the map; it has twice as many columns.", min=8, max=4096)] = 256,
) -> None:
    """Make an environment map of a mirror ball's photograph, taken from far away; its +Z is towards the camera."""
    from fit_material.renderer.light_probe.mirror_ball import Circle
    from fit_material.renderer.light_probe.probe import probe as unwrap

    given = None if circle is None else Circle(*circle)
    found = unwrap(
        balls, out, circle=given, surface=metal, encoding=encoding, exposure=_exposure(exposure), height=height
    )
    say(f"ball: --circle {found.circle.x:.1f} {found.circle.y:.1f} {found.circle.radius:.1f}")
    if found.clipped:
        say(f"clipped, or beside what is: {found.clipped:.1%} of the ball; lamps there are brighter than the map says")
    say(out)


def _exposure(text: str | None):
    if text is None or text == "exif":
        return text
    try:
        return float(text)
    except ValueError:
        raise InputError("--exposure", value=text, expected="a number, or exif") from None
