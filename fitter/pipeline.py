"""From a scene file to a result on disk: what `fit-material fit` does, without command line or printing."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from fitter import quality
from fitter.curves import reflectance_curve
from fitter.effects import effects_of
from fitter.fidelity import PRESETS, Fidelity
from fitter.mtl import ordinary_mtl, thesis_mtl
from fitter.nearest import nearest_metals
from fitter.photographs import Photograph, read_photograph
from fitter.report import ViewPictures, comparison_png, render_report
from fitter.result import (
    FittedMaterial,
    InputFile,
    Model,
    Result,
    Time,
    sha256_of,
    write_result,
)
from fitter.search import Fit, fit_metal, radiance_of
from fitter.selection import Observations, choose_pixels
from fitter.solve import SOLVERS
from fitter.summary import describe, fitted_material, status_of
from fitter.uncertainty import Spread, spread
from fitter.viewer_roughness import viewer_roughness
from renderer import gbuffer
from renderer.atomic import replaced_together, write_bytes_atomically, write_text_atomically
from renderer.environment import Environment, read_environment
from renderer.errors import InputError
from renderer.gbuffer import Tracer
from renderer.mesh import Mesh, Shape
from renderer.picture import draw
from renderer.scene import Scene, read_scene, read_shape
from renderer.threads import one_thread_per_operation

Progress = Callable[[str, float], None]

FEWER_SHOWN = 2  # half the fit's directions make the report's pictures; their noise is in `quality`
SHOWN_FOOTPRINT = 2


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes:
        fidelity: a preset, or one's own.
        solver: "lm", "adam" or "lbfgs".
        seed: of the choice of pixels and of the integration.
        device: where light tables are integrated, in torch's words.
        command: the command line, for the report.
    """

    fidelity: Fidelity = PRESETS["standard"]
    solver: str = "lm"
    seed: int = 0
    device: str = "cpu"
    command: str = ""


@dataclass(frozen=True)
class Loaded:
    """Everything that was read.

    Attributes:
        name: of the output files: the mesh file's, or the shape's.
        material: name of the one material.
    """

    scene: Scene
    photographs: tuple[Photograph, ...]
    shape: Shape
    environment: Environment
    name: str
    material: str
    inputs: tuple[InputFile, ...]


def fit_scene(
    scene_file: Path,
    out: Path,
    options: FitOptions,
    progress: Progress = lambda stage, share: None,
    begun: float | None = None,
) -> Result:
    """Fit the material of a scene and write `result.json`, two MTL files and `report.html` into a folder.

    Files of an earlier result are replaced when all new ones are whole, and not before.

    Args:
        scene_file: `scene.toml`.
        out: folder; made if it is not there.
        options: how to fit.
        progress: told the stage and its share done.
        begun: `time.perf_counter()` when the program began, so that its start-up counts as loading.

    Raises:
        InputError: about the first thing in the input that is wrong.
    """
    began = time.perf_counter() if begun is None else begun
    fidelity, device = options.fidelity, _device(options.device)
    progress("reading", 0)
    loaded = load(scene_file)
    read = time.perf_counter()
    with one_thread_per_operation(), replaced_together(out) as folder:
        progress("choosing pixels", 0)
        trace = gbuffer.tracer(loaded.shape)
        observed = choose_pixels(
            loaded.photographs,
            trace,
            scene_file,
            count=fidelity.pixels,
            footprint=fidelity.footprint,
            seed=options.seed,
        )
        environment = replace(loaded.environment, radiance=loaded.environment.radiance.to(device))
        solver = SOLVERS[options.solver]
        fit = fit_metal(observed, environment, fidelity, solver, seed=options.seed, progress=progress)
        clock = _Clock(began, read, time.perf_counter(), fit.solve_seconds)
        progress("writing the report", 0)
        uncertainty = spread(fit.residuals, fit.halves, fit.x)
        views = _views(loaded, trace, fit, environment, fidelity, options.seed)
        material = _material(loaded, observed, fit, fidelity, uncertainty)
        result = _result(loaded, observed, fit, material, fidelity, views, clock)
        curve = reflectance_curve(fit.residuals.model.reflectance, fit.residuals.coordinates, fit.x, uncertainty)
        page = render_report(result, views, [curve], command=options.command)
        write_text_atomically(folder / "report.html", page)
        write_bytes_atomically(folder / "comparison.png", comparison_png(views))
        write_text_atomically(folder / f"{loaded.name}.thesis.mtl", thesis_mtl(result.materials))
        write_text_atomically(folder / f"{loaded.name}.mtl", ordinary_mtl(result.materials))
        result = result.model_copy(update={"time": clock.now()})  # the page cannot know how long it took itself
        write_result(result, folder / "result.json")
    return result


@dataclass(frozen=True)
class _Clock:
    """When the stages ended, by `time.perf_counter()`, and the seconds of the second that solvers took."""

    began: float
    read: float
    fitted: float
    solving: float

    def now(self) -> Time:
        """The result's times, up to now."""
        now = time.perf_counter()
        return Time(
            load=self.read - self.began,
            prepare=self.fitted - self.read - self.solving,
            solve=self.solving,
            report=now - self.fitted,
            total=now - self.began,
        )


def _device(name: str) -> torch.device:
    """A device by torch's name for it, once it has shown that it computes here."""
    try:
        device = torch.device(name)
        torch.ones(1, device=device).sum().item()
    except Exception as error:  # each kind of device has its own way to be absent
        count = torch.cuda.device_count()
        known = ", ".join(["cpu", *(f"cuda:{i}" for i in range(count))])
        raise InputError("--device", value=name, expected=f"one that torch can use here: {known}") from error
    return device


def load(scene_file: Path) -> Loaded:
    """Read and check a scene with all its files.

    Raises:
        InputError: a file or field is wrong, or asks for what this version does not do.
    """
    scene = read_scene(scene_file)
    _require_supported(scene, scene_file)
    shape = read_shape(scene.geometry)
    name, *further = shape.material_names if isinstance(shape, Mesh) else ("default",)
    if further:
        expected = f"a mesh of one material; this one names {', '.join([name, *further])}"
        raise InputError(scene_file, "geometry.mesh", scene.geometry.mesh or "", expected)
    photographs = tuple(read_photograph(spec, scene_file, i) for i, spec in enumerate(scene.photographs))
    light = scene.environment
    environment = read_environment(light.map, rotation=light.rotation, scale=light.scale)
    given = scene.materials[0].name if scene.materials else name
    if isinstance(shape, Mesh) and given != name:
        raise InputError(scene_file, "materials[0].name", given, f"the name of the mesh's material, {name}")
    stem = scene.geometry.mesh.stem if scene.geometry.mesh else str(scene.geometry.shape)
    return Loaded(scene, photographs, shape, environment, stem, given, _inputs(scene, scene_file))


def _require_supported(scene: Scene, scene_file: Path) -> None:
    """Refuse what the contract of scene.toml allows and this version would otherwise silently ignore."""
    if scene.lights:
        raise InputError(scene_file, "lights", "a list", "no directional lights: only environments are fitted so far")
    for i, photograph in enumerate(scene.photographs):
        if photograph.exposure == "fit":
            expected = "a number: exposures are not fitted so far"
            raise InputError(scene_file, f"photographs[{i}].exposure", '"fit"', expected)
    for i, material in enumerate(scene.materials):
        if material.type not in ("auto", "metal"):
            expected = "metal or auto: only metals are fitted so far"
            raise InputError(scene_file, f"materials[{i}].type", material.type, expected)
    if len(scene.materials) > 1:
        raise InputError(
            scene_file, "materials", f"{len(scene.materials)} tables", "one: scenes have one material so far"
        )


def _inputs(scene: Scene, scene_file: Path) -> tuple[InputFile, ...]:
    given = [scene_file, scene.cameras, scene.geometry.mesh]
    given += sorted(scene.environment.map.iterdir()) if scene.environment.map.is_dir() else [scene.environment.map]
    given += [path for photograph in scene.photographs for path in (photograph.image, photograph.mask)]
    return tuple(
        InputFile(path=str(path), sha256=sha256_of(path)) for path in given if path is not None and path.is_file()
    )


def _material(
    loaded: Loaded, observed: Observations, fit: Fit, fidelity: Fidelity, uncertainty: Spread
) -> FittedMaterial:
    nearest = nearest_metals(fit.x, fit.residuals.coordinates, uncertainty)
    rho = None if fidelity.lobe == "taps" else viewer_roughness(observed, loaded.environment, fit.metal)
    return fitted_material(loaded.material, fit, uncertainty, rho, nearest)


def _remarks(loaded: Loaded, fidelity: Fidelity) -> list[str]:
    """What of the input was left out or replaced, and what the model cannot follow, a sentence each."""
    clipped, nonfinite = (sum(getattr(p, key) for p in loaded.photographs) for key in ("clipped", "nonfinite"))
    counts = [
        (loaded.environment.repaired, "texels of the environment were negative or not finite and were replaced"),
        (clipped, "clipped pixels of the photographs were left out"),
        (nonfinite, "pixels of the photographs were not finite and were left out"),
    ]
    remarks = [f"{count} {sentence}." for count, sentence in counts if count]
    if fidelity.lobe == "taps":
        remarks.append(
            "The viewer's blur follows no real lobe closely: F0 and roughness make up for the difference, which their"
            " errors do not count."
        )
    return remarks


def _views(
    loaded: Loaded, trace: Tracer, fit: Fit, environment: Environment, fidelity: Fidelity, seed: int
) -> list[ViewPictures]:
    """Each photograph beside the fitted material's picture of the same pixels."""
    views = []
    shown_samples = fidelity.samples // FEWER_SHOWN
    for photograph in loaded.photographs:
        picture = draw(
            trace,
            photograph.camera,
            photograph.mask,
            min(fidelity.footprint, SHOWN_FOOTPRINT),
            lambda surface: radiance_of(fit.metal, surface, environment, fidelity, samples=shown_samples, seed=seed),
        )
        seen = photograph.radiance[:: picture.step, :: picture.step]
        exposure = 1.0 if photograph.exposure == "fit" else photograph.exposure
        shown = [(radiance * exposure).numpy() for radiance in (seen, picture.radiance)]
        views.append(ViewPictures(photograph.name, shown[0], shown[1], picture.mask.numpy()))
    return views


def _result(
    loaded: Loaded,
    observed: Observations,
    fit: Fit,
    material: FittedMaterial,
    fidelity: Fidelity,
    views: Sequence[ViewPictures],
    clock: _Clock,
) -> Result:
    exposure = [1.0 if p.exposure == "fit" else p.exposure for p in loaded.photographs]
    return Result(
        status=status_of(fit, material),
        message=describe(fit, material, _remarks(loaded, fidelity)),
        materials=(material,),
        quality=quality.assess(views),
        exposure=tuple(exposure),
        model=Model(
            fidelity=fidelity.name,
            reflectance=fidelity.reflectance,
            lobe=fidelity.lobe,
            samples=fidelity.samples,
            pixels=len(observed.radiance),
            dtype="float32",
        ),
        effects=effects_of(fidelity, observed.self_seeing),
        time=clock.now(),
        inputs=loaded.inputs,
    )
