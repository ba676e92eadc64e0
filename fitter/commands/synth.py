"""The arguments of `fit-material synth`; heavy imports are late."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fit_material.fitter.command_line.choices import LobeName, ModelName, TypeName
from fit_material.fitter.command_line.common_options import Out, Quiet, Seed
from fit_material.fitter.command_line.output import say
from fit_material.fitter.command_line.progress_bar import progress_bar
from fit_material.renderer.errors.input_error import InputError

if TYPE_CHECKING:
    from fit_material.renderer.materials.ground_truth import ShadingModel, TrueMaterial

Channels = tuple[float, float, float] | None
Triple = Annotated[Channels, typer.Option(metavar="R G B")]


def synth(
    out: Out,
    type_: Annotated[
        TypeName, typer.Option("--type", help="Kind of material; auto takes it from what is given.")
    ] = TypeName.auto,
    metal: Annotated[str | None, typer.Option(help="A metal of the catalogue, such as Au or gold.")] = None,
    n: Triple = None,
    k: Triple = None,
    color: Annotated[Channels, typer.Option(metavar="R G B", help="Of a glossy or matte body, 0 to 1.")] = None,
    reflectance: Annotated[
        Channels, typer.Option(metavar="R G B", help="Of a glossy surface, seen from the front, 0 to 1.")
    ] = None,
    alpha: Annotated[
        float | None, typer.Option(help="Microfacet width, 0.001 to 1, or 0 for a mirror; 0.2 where left out.")
    ] = None,
    roughness: Annotated[
        float | None, typer.Option(help="Blur radius of the viewer's model, in alpha's place.")
    ] = None,
    model: Annotated[
        ModelName | None,
        typer.Option(
            help="Mitsuba's path tracing, or the viewer's shading (where --roughness is given), without --spp."
        ),
    ] = None,
    distribution: Annotated[LobeName, typer.Option(help="Distribution of the microfacets.")] = LobeName.ggx,
    materials: Annotated[
        Path | None,
        typer.Option(metavar="FILE.toml", help="A material for each name in the mesh, in the options' place."),
    ] = None,
    mesh: Annotated[Path | None, typer.Option(help="Any mesh file; without it the unit sphere.")] = None,
    env: Annotated[str, typer.Option(help="studio, sunsky, a map, or a folder with six faces.")] = "studio",
    light: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(metavar="X Y Z R G B", help="A directional light: towards it, and its irradiance."),
    ] = None,
    views: Annotated[int, typer.Option(help="Number of photographs.")] = 3,
    size: Annotated[int, typer.Option(help="Their width and height in pixels.")] = 256,
    spp: Annotated[int, typer.Option(help="Samples per pixel; Mitsuba's alone, the viewer's model has one.")] = 1024,
    noise: Annotated[float, typer.Option(help="Relative noise to add, as a standard deviation.")] = 0.0,
    seed: Seed = 0,
    variant: Annotated[
        str, typer.Option(help="Mitsuba's: scalar_rgb, or llvm_ad_rgb, which is faster; auto takes it where LLVM is.")
    ] = "auto",
    quiet: Quiet = False,
) -> None:
    """Photograph an object of known materials: EXR files, scene.toml to fit them, truth.json to compare."""
    said = {"metal": metal, "n": n, "k": k, "color": color, "reflectance": reflectance}
    said |= {"alpha": alpha, "roughness": roughness}
    asked = None if model is None else model.value
    known, chosen = (
        _true_material(asked, type=type_.value, distribution=distribution.value, **said)
        if materials is None
        else _true_materials(materials, asked, said)
    )
    from fit_material.renderer.scene.lights import light_option  # after the slips that need no torch
    from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

    options = SynthOptions(
        known,
        model=chosen,
        mesh=mesh,
        env=env,
        lights=() if light is None else (light_option(light),),
        views=views,
        size=size,
        spp=spp,
        noise=noise,
        seed=seed,
        variant=variant,
    )
    with progress_bar(quiet) as progress:
        scene = synthesise(options, out, progress)
    say(scene)


def _true_material(asked: Any, **said: Any) -> tuple[TrueMaterial, ShadingModel]:
    """What the object is made of, and the model that shows it."""
    from fit_material.renderer.materials.material_arguments import shading_model, true_material, with_default_alpha

    described = true_material(**said)
    model = shading_model(asked, described)
    return with_default_alpha(described, model), model


def _true_materials(path: Path, asked: Any, said: dict[str, Any]) -> tuple[dict[str, TrueMaterial], ShadingModel]:
    """The same, of each material by name, from a file that has all of them."""
    for key, value in said.items():
        if value is not None:
            raise InputError(f"--{key}", value=value, expected=f"no {key} beside --materials, whose file says all")
    from fit_material.renderer.materials.material_file import read_materials

    return read_materials(path, asked)
