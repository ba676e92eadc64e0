"""The arguments of `fit-material fit` and `demo`, and what they print; heavy imports are late."""

from __future__ import annotations

import shlex
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from fit_material.fitter.command_line.choices import (
    DtypeName,
    FidelityName,
    FittedLobeName,
    MapName,
    PriorName,
    ReflectanceName,
    SolverName,
    TypeName,
)
from fit_material.fitter.command_line.common_options import Device, Out, Quiet, Seed, With, Without
from fit_material.fitter.command_line.output import complain, say
from fit_material.fitter.command_line.progress_bar import progress_bar
from fit_material.fitter.command_line.signature import with_parameters_of
from fit_material.fitter.options.fidelity import fidelity_of
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.renderer.errors.input_error import InputError

BEGUN = time.perf_counter()
DONE, NO_MATERIAL = 0, 1  # exit codes


def chosen(
    type_: Annotated[
        TypeName, typer.Option("--type", help="Of materials that the scene leaves open; auto tries all.")
    ] = TypeName.auto,
    fidelity: Annotated[
        FidelityName, typer.Option(help="How accurately, for how much time; the options below change one choice each.")
    ] = FidelityName.standard,
    reflectance: Annotated[
        ReflectanceName | None, typer.Option(help="Of metals; only conductor, the exact one, separates n from k.")
    ] = None,
    lobe: Annotated[
        FittedLobeName | None, typer.Option(help="Microfacets, or the viewer's blur: its 49 taps, or converged.")
    ] = None,
    samples: Annotated[int | None, typer.Option(help="Directions per pixel and roughness, 16 to 65536.")] = None,
    pixels: Annotated[int | None, typer.Option(help="How many are fitted, 100 to 10000000.")] = None,
    levels: Annotated[int | None, typer.Option(help="Roughnesses of the last table, 3 to 32.")] = None,
    environment_size: Annotated[
        int | None, typer.Option(help="Columns of the environment map, 16 to 32768; 0 leaves it as it is.")
    ] = None,
    dtype: Annotated[DtypeName | None, typer.Option(help="Of the light tables.")] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="How far determined numbers may be off, relative: 0.01 takes pixels and samples for 1 %."),
    ] = None,
    prior: Annotated[
        PriorName, typer.Option(help="What stands in for n and k that the photographs leave open.")
    ] = PriorName.none,
    polish: Annotated[
        bool, typer.Option("--polish", help="Fit metals once more with Mitsuba's paths: interreflection. Needs LLVM.")
    ] = False,
    refine_pose: Annotated[
        bool,
        typer.Option("--refine-pose", help="Mend poses that are off by up to 2° and 1 %, by outlines and pixels."),
    ] = False,
    maps: Annotated[
        list[MapName] | None,
        typer.Option(help="Textures to recover, of glossy and matte materials; the mesh needs texture coordinates."),
    ] = None,
    with_: With = None,
    without: Without = None,
    no_check: Annotated[bool, typer.Option("--no-check", help="Do not check the input, as `check` does.")] = False,
    solver: Annotated[SolverName, typer.Option(help="Least squares by which method.")] = SolverName.lm,
    seed: Seed = 0,
    device: Device = "cpu",
) -> FitOptions:
    """How to fit, by the words of the command line: the options of `fit`, and of every fit of `batch`.

    Raises:
        InputError: a value is out of its range, or chosen by another option already.
    """
    named = {"reflectance": reflectance, "lobe": lobe, "dtype": dtype}
    numbers = {"samples": samples, "pixels": pixels, "levels": levels, "environment_size": environment_size}
    words = {key: None if name is None else name.value for key, name in named.items()}
    accuracy = fidelity_of(fidelity.value, **words, **numbers)  # type: ignore[arg-type] — the enums' values
    _require_free(tolerance, {key: numbers[key] for key in ("samples", "pixels", "levels")})
    return FitOptions(
        accuracy,
        solver.value,
        seed,
        device,
        type=type_.value,
        prior=prior.value,
        polish=polish,
        tolerance=tolerance,
        refine_pose=refine_pose,
        check=not no_check,
        maps=tuple(dict.fromkeys(each.value for each in maps or ())),
        wanted=tuple(with_ or ()),
        unwanted=tuple(without or ()),
    )


@with_parameters_of(chosen)
def fit(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml")],
    out: Out,
    quiet: Quiet = False,
    **options: Any,
) -> None:
    """Fit the material of a scene; writes result.json, report.html and two MTL files."""
    raise typer.Exit(_fit(scene, out, chosen(**options), quiet, BEGUN))


def demo(out: Out = Path("demo"), quiet: Quiet = False) -> None:
    """Photograph a gold ball with Mitsuba and fit it; needs no input."""
    from fit_material.fitter.pipeline.output_files import output_names
    from fit_material.fitter.result.written_files import replaceable_by_fit
    from fit_material.renderer.materials.material_arguments import true_material
    from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise

    gold = true_material(metal="gold", alpha=0.15)
    options, how = SynthOptions(gold, size=128, spp=512), FitOptions(type="metal")
    replaceable_by_fit(out, ()).require(out, output_names("sphere", ["default"], how))
    with progress_bar(quiet) as progress:
        scene = synthesise(options, out / "photographs", progress)
    code = _fit(scene, out, how, quiet, time.perf_counter())
    say(f"truth: {out / 'photographs' / 'truth.json'}")
    raise typer.Exit(code)


def _require_free(tolerance: float | None, numbers: dict[str, int | None]) -> None:
    """Refuse options that a tolerance chooses."""
    for key, value in numbers.items():
        if tolerance is not None and value is not None:
            raise InputError(f"--{key}", value=value, expected=f"no {key} beside --tolerance, which chooses them")


def _fit(scene: Path, out: Path, options: FitOptions, quiet: bool, begun: float) -> int:
    warnings: list[str] = []
    with progress_bar(quiet) as progress:
        progress("starting", 0)
        from fit_material.fitter.pipeline.fit_scene import fit_scene

        command = shlex.join(["fit-material", *sys.argv[1:]])
        result = fit_scene(scene, out, replace(options, command=command), progress, begun, warnings.append)
    for sentence in warnings:
        complain(sentence)
    _print_result(result, out)
    return DONE if result.status == "converged" else NO_MATERIAL


def _print_result(result, out: Path) -> None:
    from fit_material.fitter.result.formatting import PARAMETERS, told_numbers

    for material in result.materials:
        nearest = f", most like {material.nearest[0].name}" if material.nearest else ""
        say(f"{material.name}: {material.type}{nearest}")
        for key in PARAMETERS:
            if getattr(material, key) is not None:
                say(f"  {key:11}", "   ".join(told_numbers(material, key)))
    say(result.message)
    say(f"report: {out / 'report.html'}")
