"""The arguments of `fit-material view`; heavy imports are late."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated

import typer

from fit_material.fitter.command_line.output import say

Numbers = tuple[float, float, float]


class DialectName(enum.StrEnum):
    auto = "auto"
    thesis = "thesis"
    ordinary = "ordinary"


class CurveName(enum.StrEnum):
    clamp = "clamp"
    reinhard = "reinhard"
    aces = "aces"


class ComparisonName(enum.StrEnum):
    beside = "beside"
    swipe = "swipe"
    difference = "difference"


def view(
    model: Annotated[Path, typer.Argument(metavar="MODEL.obj", help="Any mesh file.")],
    env: Annotated[
        str | None,
        typer.Option(help="studio, sunsky, a map, or a folder with six faces; else the photographs', or studio."),
    ] = None,
    mtl: Annotated[
        Path | None,
        typer.Option(help="The materials; without it MODEL.thesis.mtl beside the mesh, else the mesh's own."),
    ] = None,
    screenshot: Annotated[
        Path | None, typer.Option(help="Write this .png, or .exr before tone mapping, and show no window.")
    ] = None,
    turntable: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write a turn round the model as PNG files, without a window.")
    ] = None,
    frames: Annotated[int, typer.Option(help="Of the turntable.")] = 72,
    size: Annotated[
        tuple[int, int] | None, typer.Option(metavar="W H", help="In pixels; 1280 800 where left out.")
    ] = None,
    origin: Annotated[
        Numbers | None, typer.Option(metavar="X Y Z", help="Where the camera stands; without it, it sees all.")
    ] = None,
    target: Annotated[
        Numbers | None, typer.Option(metavar="X Y Z", help="Where it looks; without it the middle.")
    ] = None,
    up: Annotated[Numbers, typer.Option(metavar="X Y Z", help="What is upwards in the picture.")] = (0.0, 1.0, 0.0),
    fov: Annotated[float, typer.Option(help="Angle of view from left to right, degrees.")] = 35.0,
    exposure: Annotated[float, typer.Option(help="In stops: every one doubles the brightness.")] = 0.0,
    curve: Annotated[CurveName, typer.Option(help="Tone mapping.")] = CurveName.clamp,
    rotation: Annotated[float, typer.Option(help="Of the environment about +Y, degrees.")] = 0.0,
    sky: Annotated[bool, typer.Option(help="Show the environment; an EXR without it has coverage as alpha.")] = True,
    neighbours: Annotated[bool, typer.Option(help="Let objects mirror each other.")] = True,
    antialias: Annotated[int, typer.Option(help="Samples along each side of a pixel.")] = 4,
    ambient: Annotated[
        Numbers | None, typer.Option(metavar="R G B", help="Constant ambient light in the environment's place.")
    ] = None,
    light: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(metavar="X Y Z R G B", help="A directional light: towards it, and its irradiance."),
    ] = None,
    codes: Annotated[
        str, typer.Option(help="Values of Ns for each type in the thesis's MTL files.")
    ] = "matte=0,glossy=1,metal=2",
    dialect: Annotated[DialectName, typer.Option(help="Of the MTL file.")] = DialectName.auto,
    outside: Annotated[
        bool, typer.Option("--outside", help="Read textures from outside of the model's folder, too.")
    ] = False,
    photograph: Annotated[
        Path | None, typer.Option(metavar="SCENE.toml", help="Compare with this scene's photographs, by their cameras.")
    ] = None,
    view_: Annotated[int, typer.Option("--view", help="Which photograph, from 1.")] = 1,
    compare: Annotated[
        ComparisonName, typer.Option(help="How the photograph is laid to the render.")
    ] = ComparisonName.beside,
) -> None:
    """Draw a model in its surroundings: in a window, or into files."""
    from fit_material.renderer.viewer.run import ViewOptions, show

    options = ViewOptions(
        model=model,
        env=env,
        mtl=mtl,
        screenshot=screenshot,
        turntable=turntable,
        frames=frames,
        size=size or (1280, 800),
        origin=origin,
        target=target,
        up=up,
        fov=fov,
        exposure=exposure,
        curve=curve.value,
        rotation=rotation,
        sky=sky,
        neighbours=neighbours,
        antialias=antialias,
        ambient=ambient,
        light=light,
        codes=codes,
        dialect=dialect.value,
        photograph=photograph,
        view=view_,
        compare=compare.value,
        outside=outside,
    )
    for path in show(options):
        say(path)
