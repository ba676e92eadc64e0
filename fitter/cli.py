"""The `fit-material` command: reads arguments, calls, writes, chooses the exit code. Heavy imports are late."""

from __future__ import annotations

import io
import os
import shlex
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.exceptions import TyperException

from fitter.advise_command import advise
from fitter.frontier_command import frontier
from fitter.option_names import (
    DtypeName,
    FidelityName,
    FittedLobeName,
    LobeName,
    ModelName,
    PriorName,
    ReflectanceName,
    SolverName,
    TypeName,
)
from fitter.printing import flush, say
from fitter.progress import progress_bar
from fitter.view_command import view
from renderer.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fitter.fidelity import Fidelity
    from fitter.result import FittedMaterial
    from renderer.truth import ShadingModel, TrueMaterial

BEGUN = time.perf_counter()
DONE, NO_MATERIAL, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130
UNTOUCHED = "interrupted; files of earlier results are as they were"

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Recover what an object is made of from photographs: n, k, roughness, with error bars.",
)

app.command()(view)
app.command()(advise)
app.command()(frontier)


def _folder(text: str | Path) -> Path:
    if not str(text):
        raise InputError("-o", value='""', expected="a folder that can be written; . is this one")
    return Path(text)


Out = Annotated[
    Path,
    typer.Option(
        "-o", "--out", metavar="PATH", parser=_folder, help="Folder for the results; made if it is not there."
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
Seed = Annotated[
    int, typer.Option(help="Of everything random; the same seed gives the same files.", min=0, max=2**31 - 1)
]
Channels = tuple[float, float, float] | None
Triple = Annotated[Channels, typer.Option(metavar="R G B")]


def main() -> None:
    """Run the command line; the user's mistakes end in one sentence and exit code 2, never in a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a locale may have no ± or σ
            stream.reconfigure(errors="backslashreplace")
    pressed = _watch_for_interrupts()
    try:
        code = _run(sys.argv[1:] or ["--help"])
        if code == INTERRUPTED:  # typer's own word for Ctrl-C inside of a command
            raise KeyboardInterrupt
        sys.exit(code or DONE)
    except InputError as error:
        _fail(str(error), WRONG_INPUT)
    except TyperException as error:
        _fail(_usage(error), WRONG_INPUT)
    except KeyboardInterrupt:
        _fail(UNTOUCHED, INTERRUPTED)
    except Exception as error:
        if pressed.is_set():
            _fail(UNTOUCHED, INTERRUPTED)
        if os.environ.get("FIT_MATERIAL_DEBUG"):
            raise
        reason = " ".join(str(error).split()) or type(error).__name__
        _fail(f"internal error, please report it: {reason} (FIT_MATERIAL_DEBUG=1 shows where)", NO_MATERIAL)


def _watch_for_interrupts() -> threading.Event:
    """An event that Ctrl-C sets: a library that is being imported may turn the interrupt into an error of its own."""
    pressed = threading.Event()

    def note(signum: int, frame: object) -> None:
        pressed.set()
        raise KeyboardInterrupt

    with suppress(ValueError):  # outside the main thread nobody sends signals
        signal.signal(signal.SIGINT, note)
    return pressed


def _run(arguments: list[str]) -> int:
    """The command's exit code, whether or not somebody reads what it prints."""
    try:
        code = app(arguments, prog_name="fit-material", standalone_mode=False)
    except SystemExit:  # typer's own, where nobody reads the help
        code = DONE
    flush()
    return code


def _usage(error: TyperException) -> str:
    """What is wrong with the arguments, in one sentence, and where to read what is right."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "fit-material"
    message = " ".join(error.format_message().split()).rstrip(".")  # type: ignore[attr-defined] — of click's part
    return f"{message[:1].lower()}{message[1:]}; `{command} --help` lists what there is"


def _fail(sentence: str, code: int) -> None:
    print(f"fit-material: {sentence}", file=sys.stderr)
    sys.exit(code)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"fit-material {version('fit-material')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


@app.command()
def fit(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml")],
    out: Out,
    type_: Annotated[
        TypeName, typer.Option("--type", help="Of materials that the scene leaves open; auto tries all.")
    ] = TypeName.auto,
    fidelity: Annotated[
        FidelityName, typer.Option(help="How accurately, for how much time; the options below change one choice each.")
    ] = FidelityName.standard,
    reflectance: Annotated[
        ReflectanceName | None, typer.Option(help="Of metals; only conductor, the exact one, tells n from k.")
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
    solver: Annotated[SolverName, typer.Option(help="Least squares by which method.")] = SolverName.lm,
    seed: Seed = 0,
    device: Annotated[str, typer.Option(help="Where light is integrated: cpu, cuda, cuda:1 …")] = "cpu",
    quiet: Quiet = False,
) -> None:
    """Fit the material of a scene; writes result.json, report.html and two MTL files."""
    from fitter.fidelity import fidelity_of

    named = {"reflectance": reflectance, "lobe": lobe, "dtype": dtype}
    numbers = {"samples": samples, "pixels": pixels, "levels": levels, "environment_size": environment_size}
    words = {key: None if name is None else name.value for key, name in named.items()}
    accuracy = fidelity_of(fidelity.value, **words, **numbers)  # type: ignore[arg-type] — the enums' values
    _require_free(tolerance, {key: numbers[key] for key in ("samples", "pixels", "levels")})
    chosen = (type_.value, accuracy, prior.value, solver.value)
    code = _fit(scene, out, *chosen, seed, device, quiet, polish=polish, tolerance=tolerance)
    raise typer.Exit(code)


@app.command()
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
    from renderer.scene import light_option  # after the slips that need no torch
    from renderer.synth import SynthOptions, synthesise

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


@app.command()
def demo(out: Out = Path("demo"), quiet: Quiet = False) -> None:
    """Photograph a gold ball with Mitsuba and fit it; needs no input."""
    from fitter.fidelity import PRESETS
    from renderer.synth import SynthOptions, synthesise

    gold, _ = _true_material(None, metal="gold", alpha=0.15)
    options = SynthOptions(gold, size=128, spp=512)
    with progress_bar(quiet) as progress:
        scene = synthesise(options, out / "photographs", progress)
    code = _fit(scene, out, "metal", PRESETS["standard"], "none", "lm", 0, "cpu", quiet, begun=time.perf_counter())
    say(f"truth: {out / 'photographs' / 'truth.json'}")
    raise typer.Exit(code)


@app.command()
def export(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json")],
    out: Out,
    to: Annotated[str, typer.Option(help="Formats, separated by commas: thesis, mtl.")] = "thesis,mtl",
) -> None:
    """Write the materials of a result in other programs' formats."""
    from fitter.export import export as write
    from fitter.result import read_result

    formats = [name.strip() for name in to.split(",")]
    for path in write(read_result(result), formats, out, _stem(result), result):
        say(path)


def _stem(result: Path) -> str:
    """What `fit` called the material's files beside the result, or the folder's name."""
    folder, ending = result.resolve().parent, ".thesis.mtl"
    names = [path.name.removesuffix(ending) for path in folder.glob(f"?*{ending}")]
    return names[0] if len(names) == 1 else folder.name or "material"


def _true_material(asked: Any, **said: Any) -> tuple[TrueMaterial, ShadingModel]:
    """What the object is made of, and the model that shows it."""
    from fitter.true_material import shading_model, true_material, with_default_alpha

    described = true_material(**said)
    model = shading_model(asked, described)
    return with_default_alpha(described, model), model


def _true_materials(path: Path, asked: Any, said: dict[str, Any]) -> tuple[dict[str, TrueMaterial], ShadingModel]:
    """The same, of each material by name, from a file that says all."""
    for key, value in said.items():
        if value is not None:
            raise InputError(f"--{key}", value=value, expected=f"no {key} beside --materials, whose file says all")
    from fitter.material_file import read_materials

    return read_materials(path, asked)


def _require_free(tolerance: float | None, numbers: dict[str, int | None]) -> None:
    """What a tolerance chooses is not to be said as well."""
    for key, value in numbers.items():
        if tolerance is not None and value is not None:
            raise InputError(f"--{key}", value=value, expected=f"no {key} beside --tolerance, which chooses them")


def _fit(
    scene: Path,
    out: Path,
    kind: str,
    fidelity: Fidelity,
    prior: str,
    solver: str,
    seed: int,
    device: str,
    quiet: bool,
    begun: float = BEGUN,
    polish: bool = False,
    tolerance: float | None = None,
) -> int:
    with progress_bar(quiet) as progress:
        progress("starting", 0)
        from fitter.pipeline import FitOptions, fit_scene

        command = shlex.join(["fit-material", *sys.argv[1:]])
        told = (solver, seed, device, command, kind, prior, polish, tolerance)
        options = FitOptions(fidelity, *told)  # type: ignore[arg-type] — PriorName's
        result = fit_scene(scene, out, options, progress, begun)
    _print_result(result, out)
    return DONE if result.status == "converged" else NO_MATERIAL


def _print_result(result, out: Path) -> None:
    for material in result.materials:
        nearest = f", most like {material.nearest[0].name}" if material.nearest else ""
        say(f"{material.name}: {material.type}{nearest}")
        for key in ("n", "k", "color", "reflectance", "f0", "alpha", "roughness"):
            if getattr(material, key) is not None:
                say(f"  {key:11}", "   ".join(_numbers(material, key)))
    say(result.message)
    say(f"report: {out / 'report.html'}")


def _numbers(material: FittedMaterial, key: str) -> Iterator[str]:
    """A parameter's values with their errors; with the word of the catalogue where it is that one's."""
    parts = [getattr(part, key, None) for part in (material, material.stderr, material.from_prior)]
    count = 3 if isinstance(parts[0], tuple) else 1
    for value, error, taken in zip(*(_channels(part, count) for part in parts), strict=True):
        yield _with_error(value, error) if not taken else f"{_with_error(value, error, '')} (catalogue)"


def _with_error(value: float, error: float | None, none: str = " (not determined)") -> str:
    return f"{value:.4g} ± {error:.4g}" if error is not None else f"{value:.4g}{none}"


def _channels(part: Any, count: int) -> Any:
    return part if isinstance(part, tuple) else (part,) * count


if __name__ == "__main__":
    main()
