"""From a scene file to a result on disk: what `fit-material fit` does, without command line or printing."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from fit_material.fitter.export.mtl import ordinary_mtl, thesis_mtl
from fit_material.fitter.fitted.limitations import caveats
from fit_material.fitter.fitted.nuisance_estimates import Beside, found_beside
from fit_material.fitter.fitted.part import FittedPart, painted
from fit_material.fitter.fitted.planned import PlannedFit
from fit_material.fitter.fitted.summary import status_of
from fit_material.fitter.forward.lighting import setting_of
from fit_material.fitter.least_squares.nuisances import require_known
from fit_material.fitter.least_squares.solvers import compiling
from fit_material.fitter.observations.photograph import known_exposure
from fit_material.fitter.observations.scene_data import Loaded, load
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.pipeline.map_files import map_files, with_map_names
from fit_material.fitter.pipeline.option_checks import require_consistent, require_mappable
from fit_material.fitter.pipeline.output_files import SIZE, require_room_for_outputs
from fit_material.fitter.pipeline.planned_fit import fit_planned
from fit_material.fitter.report import image_quality
from fit_material.fitter.report.effect_pictures import strips
from fit_material.fitter.report.image_quality import ViewPictures
from fit_material.fitter.report.outlier_map import OutlierMap, outlier_maps, outlier_sentences
from fit_material.fitter.report.pictures import map_pictures
from fit_material.fitter.report.reflectance_curve import Curve, reflectance_curve
from fit_material.fitter.report.report import comparison_png, render_report
from fit_material.fitter.result.schema import Effect, Model, Result, Time, write_result
from fit_material.fitter.result.written_files import outputs_of
from fit_material.renderer.compute.devices import torch_device
from fit_material.renderer.compute.threads import one_thread_per_operation
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.atomic import replaced_together, write_bytes_atomically, write_text_atomically
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.picture import draw
from fit_material.shaders.materials.fresnel_models import REFLECTANCES

if TYPE_CHECKING:
    from fit_material.fitter.poses.refinement import RefinedPoses

SHOWN_SAMPLES = 128  # directions per pixel of the report's pictures, at most; their noise is in `quality`
SHOWN_FOOTPRINT = 2


def fit_scene(
    scene_file: Path,
    out: Path,
    options: FitOptions,
    progress: Progress = lambda stage, share: None,
    begun: float | None = None,
    warn: Callable[[str], None] = lambda sentence: None,
    target: Path | None = None,
) -> Result:
    """Fit the materials of a scene and write `result.json`, two MTL files and `report.html` into a folder.

    Files of an earlier result are replaced when all new ones are whole, and not before; files that the scene is read
    from, or that no fit has written, never.

    Args:
        scene_file: `scene.toml`.
        out: folder; made if it is not there.
        options: how to fit.
        progress: told the stage and its share done.
        begun: `time.perf_counter()` when the program began, so that its start-up counts as loading.
        warn: told what is wrong with the input, if that is looked for.
        target: where whoever called moves the files afterwards; `out` where left out.

    Raises:
        InputError: about the first thing in the input that is wrong, or about a file that may not be replaced.
    """
    began = time.perf_counter() if begun is None else begun
    device = torch_device(options.device)
    require_consistent(options)
    if options.polish or "interreflection" in options.wanted:
        from fit_material.fitter.effects.interreflection import require_polishable

        require_polishable(options.fidelity)
    progress("reading", 0)
    loaded = load(scene_file)
    require_mappable(loaded.shape, loaded.scene.geometry.mesh, options.maps)
    for option, is_asked in (("--maps", options.maps), ("--refine-pose", options.refine_pose)):
        if is_asked:
            require_known(loaded.scene, scene_file, f"beside {option}: those that a fit without it has found")
    final = out if target is None else target
    allowed = require_room_for_outputs(loaded, scene_file, final, options)
    read = time.perf_counter()
    if options.solver == "lm":
        compiling().add_done_callback(_load_plotting)
    with one_thread_per_operation(), replaced_together(out, replaceable=allowed, size=SIZE) as folder:
        trace = loaded.tracer()
        warnings = _warnings(loaded, trace, scene_file, options, progress, warn)
        setting = setting_of(loaded, options, device)
        refined = _refined(loaded, trace, options, device, progress, scene_file) if options.refine_pose else None
        loaded = loaded if refined is None else refined.loaded
        planned = fit_planned(loaded, trace, setting, options, progress, scene_file)
        if "color" in options.maps:
            from fit_material.fitter.textures.color_map import with_color_maps

            planned = with_color_maps(planned, loaded, trace, options, progress)
            planned = replace(planned, parts=with_map_names(planned.parts, loaded.name))
        parts = planned.parts
        solving = sum(part.choice.fit.solve_seconds for part in parts)
        clock = _Clock(began, read, time.perf_counter(), loaded.photographs.seconds, solving)
        progress("writing the report", 0)
        beside = found_beside(
            [(part.choice.fit, part.spread) for part in parts], [each.name for each in loaded.photographs.thumbnails]
        )
        views = _views(loaded, trace, parts, beside)
        outliers = outlier_maps(parts, loaded.photographs.thumbnails, views)
        result = _result(_Found(loaded, planned, beside, refined, views, outliers, warnings), clock)
        alone = strips(planned, loaded.photographs.thumbnails[0], trace)
        curves = [_curve(part) for part in parts]
        maps = [(part.material.name, *map_pictures(part.color_map)) for part in parts if part.color_map is not None]
        page = render_report(result, views, curves, alone, outliers, maps=maps, command=options.command)
        for name, data in map_files(parts).items():
            write_bytes_atomically(folder / name, data)
        write_text_atomically(folder / "report.html", page)
        write_bytes_atomically(folder / "comparison.png", comparison_png(views))
        write_text_atomically(folder / f"{loaded.name}.thesis.mtl", thesis_mtl(result.materials))
        write_text_atomically(folder / f"{loaded.name}.mtl", ordinary_mtl(result.materials))
        if refined is not None and refined.transforms is not None:
            write_text_atomically(folder / f"{loaded.name}.transforms.json", refined.transforms)
        files = outputs_of(folder, final)
        result = result.model_copy(update={"time": clock.now(), **files})  # the page cannot know how long it took
        write_result(result, folder / "result.json")
    return result


def _load_plotting(_: object) -> None:
    """What the report will need for half a second, in the thread that has just compiled, beside the search."""
    import matplotlib.backends.backend_svg  # noqa: F401
    from skimage.metrics import structural_similarity  # noqa: F401


def _refined(
    loaded: Loaded, trace: Tracer, options: FitOptions, device: torch.device, progress: Progress, scene_file: Path
) -> RefinedPoses:
    """The scene with its cameras where they stood, found in light that is exact whatever the fit's is."""
    from fit_material.fitter.poses.refinement import pose_fidelity, refine_poses

    exactly = replace(options, fidelity=pose_fidelity(options.fidelity))
    return refine_poses(loaded, trace, setting_of(loaded, exactly, device), options, progress, scene_file)


@dataclass(frozen=True)
class _Clock:
    """When the stages ended, by `time.perf_counter()`; of the second the seconds of reading photographs, of solving."""

    began: float
    read: float
    fitted: float
    photographs: float
    solving: float

    def now(self) -> Time:
        """The result's times, up to now."""
        now = time.perf_counter()
        return Time(
            load=self.read - self.began + self.photographs,
            prepare=self.fitted - self.read - self.photographs - self.solving,
            solve=self.solving,
            report=now - self.fitted,
            total=now - self.began,
        )


@dataclass(frozen=True)
class _Found:
    """All that a result is written from.

    Attributes:
        loaded, planned: the scene and its fit.
        beside: what was fitted beside the materials; None where nothing was.
        refined: how the cameras were moved; None where they were not.
        views: photographs beside the fit.
        outliers: what it does not explain.
        warnings: what is wrong with the input, in sentences.
    """

    loaded: Loaded
    planned: PlannedFit
    beside: Beside | None
    refined: RefinedPoses | None
    views: Sequence[ViewPictures]
    outliers: Sequence[OutlierMap]
    warnings: Sequence[str]


def _warnings(
    loaded: Loaded,
    trace: Tracer,
    scene_file: Path,
    options: FitOptions,
    progress: Progress,
    warn: Callable[[str], None],
) -> list[str]:
    """What is wrong with the input, a sentence each; it stops no fit, and nor does its search."""
    if not options.check:
        return []
    from fit_material.fitter.input_checks.checks import affordable, preflight

    progress("checking the input", 0)
    try:
        most = affordable(loaded.photographs)
        found = [f"Check: {each}." for each in preflight(loaded, trace, scene_file, options.seed, most)]
    except InputError:  # the fit will say so
        return []
    except Exception as error:
        found = [f"Check: the input could not be checked ({' '.join(str(error).split())})."]
    for sentence in found:
        warn(sentence)
    return found


def _curve(part: FittedPart) -> Curve | None:
    """The reflectance curve of what mirrors."""
    fit = part.choice.fit
    if fit.material.type == "matte":
        return None
    reflectance = REFLECTANCES[part.setting.fidelity.reflectance]
    return reflectance_curve(reflectance, fit.residuals.coordinates, fit.x, part.spread)


def _message(found: _Found, fidelity: Fidelity) -> str:
    """What there is to say of each material, of the plan, of the cameras, and of the input."""
    loaded, parts = found.loaded, found.planned.parts
    told = [part.told for part in parts]
    if len(loaded.materials) > 1:
        told = [f"{part.material.name}: {sentences}" for part, sentences in zip(parts, told, strict=True)]
    told += [] if found.beside is None else found.beside.told
    told += found.planned.told
    told += [] if found.refined is None else [found.refined.told]
    told += [*caveats(loaded, parts, fidelity), *outlier_sentences(found.outliers), *found.warnings]
    return " ".join(told)


def _views(loaded: Loaded, trace: Tracer, parts: Sequence[FittedPart], beside: Beside | None) -> list[ViewPictures]:
    """Each photograph's thumbnail beside the fitted materials' picture of the same pixels."""

    def shown(part: FittedPart, surface: GBuffer) -> torch.Tensor:
        samples = min(part.setting.fidelity.samples, SHOWN_SAMPLES)
        radiance = part.setting.radiance(part.choice.fit.material, surface, samples)
        return radiance if part.polish is None else radiance + part.polish.picture(surface)

    def shade(surface: GBuffer) -> torch.Tensor:
        return painted(parts, surface, shown)

    thumbnails = loaded.photographs.thumbnails
    factors = torch.ones(len(thumbnails), 3) if beside is None else beside.factors.float()
    views = []
    for seen, factor in zip(thumbnails, factors, strict=True):
        footprint = min(parts[0].setting.fidelity.footprint, SHOWN_FOOTPRINT)
        picture = draw(trace, seen.camera, seen.mask, seen.step, footprint, shade)
        exposure = known_exposure(seen.exposure)
        photograph, fit = ((each * exposure).numpy() for each in (seen.radiance, factor * picture.radiance))
        views.append(ViewPictures(seen.name, photograph, fit, picture.mask.numpy()))
    return views


def _result(found: _Found, clock: _Clock) -> Result:
    loaded, beside, parts = found.loaded, found.beside, found.planned.parts
    setting, materials = parts[0].setting, tuple(part.material for part in parts)
    fidelity = setting.fidelity
    fitted = [1.0] * len(loaded.photographs) if beside is None else beside.exposures.tolist()
    known = [known_exposure(each.exposure) for each in loaded.photographs.thumbnails]
    types = {material.type for material in materials}
    polish = any(part.polish is not None for part in parts)
    return Result(
        status=status_of([part.choice for part in parts], materials),
        message=_message(found, fidelity),
        materials=materials,
        quality=image_quality.assess(found.views),
        exposure=tuple(factor * each for factor, each in zip(fitted, known, strict=True)),
        model=Model(
            fidelity=f"{fidelity.name}, polished by Mitsuba's path tracer" if polish else fidelity.name,
            reflectance=", ".join(fidelity.reflectance_of(kind) for kind in sorted(types, reverse=True)),
            lobe=fidelity.lobe,
            samples=max(part.setting.fidelity.samples for part in parts),
            pixels=sum(len(part.observed.measured.radiance) for part in parts),
            dtype=fidelity.dtype,
            levels=max(part.setting.fidelity.levels for part in parts),
            environment_size=setting.environment.radiance.shape[1],
        ),
        effects=tuple(Effect(name=each.name, on=each.on, why=each.why) for each in found.planned.plan.decisions),
        time=clock.now(),
        inputs=loaded.inputs,
        tolerance=tuple(part.tolerance for part in parts if part.tolerance is not None) or None,
        nuisances=None if beside is None else beside.records,
        cameras=None if found.refined is None else found.refined.cameras,
    )
