"""A fit in numbers, words and pictures: the result, and the contents of every other file, before one is written."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from fit_material.fitter.export.formats import FORMATS
from fit_material.fitter.fitted.limitations import caveats
from fit_material.fitter.fitted.nuisance_estimates import NuisanceEstimates, nuisance_estimates
from fit_material.fitter.fitted.part import FittedPart, shade_by_material
from fit_material.fitter.fitted.planned import PlannedFit
from fit_material.fitter.fitted.summary import status_of
from fit_material.fitter.observations.photograph import known_exposure
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.fitter.options.fidelity import Fidelity
from fit_material.fitter.pipeline.map_files import map_files
from fit_material.fitter.pipeline.output_files import EXPORTED
from fit_material.fitter.report import image_quality
from fit_material.fitter.report.effect_pictures import strips
from fit_material.fitter.report.image_quality import ViewPictures
from fit_material.fitter.report.outlier_map import OutlierMap, outlier_maps, outlier_sentences
from fit_material.fitter.report.pictures import map_pictures
from fit_material.fitter.report.reflectance_curve import Curve, reflectance_curve
from fit_material.fitter.report.report import comparison_png, render_report
from fit_material.fitter.result.schema import Effect, Model, Result, Time
from fit_material.fitter.result.written_files import TRANSFORMS
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.picture import draw
from fit_material.shaders.materials.fresnel_models import REFLECTANCES

if TYPE_CHECKING:
    from fit_material.fitter.poses.refinement import RefinedPoses

SHOWN_SAMPLES = 128  # directions per pixel of the report's pictures, at most; their noise is in `quality`
SHOWN_FOOTPRINT = 2


@dataclass(frozen=True)
class Clock:
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
class FittedScene:
    """A scene and its fit.

    Attributes:
        loaded: the scene as it was fitted.
        trace: rays at its object.
        planned: the fit.
        refined: how the cameras were moved before; None where they were not.
        warnings: faults of the input, in sentences.
    """

    loaded: Loaded
    trace: Tracer
    planned: PlannedFit
    refined: RefinedPoses | None
    warnings: Sequence[str]


@dataclass(frozen=True)
class _Compared:
    """A fit against its photographs.

    Attributes:
        beside: what was fitted beside the materials; None where nothing was.
        views: photographs beside the fit.
        outliers: what it does not explain.
    """

    beside: NuisanceEstimates | None
    views: Sequence[ViewPictures]
    outliers: Sequence[OutlierMap]


@dataclass(frozen=True)
class DescribedFit:
    """A fit in numbers, words and pictures.

    Attributes:
        result: as `result.json` has it, but for its own files and the time that they took.
        files: the contents of all others, by name.
    """

    result: Result
    files: Mapping[str, str | bytes]


def describe_fit(fitted: FittedScene, clock: Clock, command: str) -> DescribedFit:
    """The result, and the contents of every file that a fit writes beside it.

    Args:
        fitted: what to describe.
        clock: of the fit.
        command: the command line, for the report.
    """
    loaded, parts, seen = fitted.loaded, fitted.planned.parts, fitted.loaded.photographs.thumbnails
    beside = nuisance_estimates([(part.choice.fit, part.spread) for part in parts], [each.name for each in seen])
    views = _views(loaded, fitted.trace, parts, beside)
    outliers = outlier_maps(parts, seen, views)
    result = _result(fitted, _Compared(beside, views, outliers), clock)
    alone = strips(fitted.planned, seen[0], fitted.trace)
    curves = [_curve(part) for part in parts]
    maps = [(part.material.name, *map_pictures(part.color_map)) for part in parts if part.color_map is not None]
    textures = map_files(parts)
    files: dict[str, str | bytes] = {
        **textures,
        "report.html": render_report(result, views, curves, alone, outliers, maps=maps, command=command),
        "comparison.png": comparison_png(views),
    }
    for name in EXPORTED:
        files.update(FORMATS[name].files(result.materials, loaded.name, textures))
    moved = None if fitted.refined is None else fitted.refined.transforms
    if moved is not None:
        files[f"{loaded.name}{TRANSFORMS}"] = moved
    return DescribedFit(result, files)


def _curve(part: FittedPart) -> Curve | None:
    """The reflectance curve of a mirroring material."""
    fit = part.choice.fit
    if not fit.material.mirrors:
        return None
    reflectance = REFLECTANCES[part.lighting.fidelity.reflectance]
    return reflectance_curve(reflectance, fit.residuals.coordinates, fit.x, part.spread)


def _message(fitted: FittedScene, compared: _Compared, fidelity: Fidelity) -> str:
    """Remarks on each material, the plan, the cameras, and the input."""
    loaded, parts = fitted.loaded, fitted.planned.parts
    told = [part.told for part in parts]
    if len(loaded.materials) > 1:
        told = [f"{part.material.name}: {sentences}" for part, sentences in zip(parts, told, strict=True)]
    told += [] if compared.beside is None else compared.beside.told
    told += fitted.planned.told
    told += [] if fitted.refined is None else [fitted.refined.told]
    told += [*caveats(loaded, parts, fidelity), *outlier_sentences(compared.outliers), *fitted.warnings]
    return " ".join(told)


def _views(
    loaded: Loaded, trace: Tracer, parts: Sequence[FittedPart], beside: NuisanceEstimates | None
) -> list[ViewPictures]:
    """Each photograph's thumbnail beside the fitted materials' picture of the same pixels."""

    def shown(part: FittedPart, surface: GBuffer) -> torch.Tensor:
        samples = min(part.lighting.fidelity.samples, SHOWN_SAMPLES)
        radiance = part.lighting.radiance(part.choice.fit.material, surface, samples)
        return radiance if part.polish is None else radiance + part.polish.picture(surface)

    def shade(surface: GBuffer) -> torch.Tensor:
        return shade_by_material(parts, surface, shown)

    thumbnails = loaded.photographs.thumbnails
    factors = torch.ones(len(thumbnails), 3) if beside is None else beside.factors.float()
    views = []
    for seen, factor in zip(thumbnails, factors, strict=True):
        footprint = min(parts[0].lighting.fidelity.footprint, SHOWN_FOOTPRINT)
        picture = draw(trace, seen.camera, seen.mask, seen.step, footprint, shade)
        exposure = known_exposure(seen.exposure)
        photograph, fit = ((each * exposure).numpy() for each in (seen.radiance, factor * picture.radiance))
        views.append(ViewPictures(seen.name, photograph, fit, picture.mask.numpy()))
    return views


def _result(fitted: FittedScene, compared: _Compared, clock: Clock) -> Result:
    loaded, beside, parts = fitted.loaded, compared.beside, fitted.planned.parts
    lighting, materials = parts[0].lighting, tuple(part.material for part in parts)
    fidelity = lighting.fidelity
    exposures = [1.0] * len(loaded.photographs) if beside is None else beside.exposures.tolist()
    known = [known_exposure(each.exposure) for each in loaded.photographs.thumbnails]
    types = {material.type for material in materials}
    polish = any(part.polish is not None for part in parts)
    return Result(
        status=status_of([part.choice for part in parts], materials),
        message=_message(fitted, compared, fidelity),
        materials=materials,
        quality=image_quality.assess(compared.views),
        exposure=tuple(factor * each for factor, each in zip(exposures, known, strict=True)),
        model=Model(
            fidelity=f"{fidelity.name}, polished by Mitsuba's path tracer" if polish else fidelity.name,
            reflectance=", ".join(fidelity.reflectance_of(kind) for kind in sorted(types, reverse=True)),
            lobe=fidelity.lobe,
            samples=max(part.lighting.fidelity.samples for part in parts),
            pixels=sum(len(part.observed.measured.radiance) for part in parts),
            dtype=fidelity.dtype,
            levels=max(part.lighting.fidelity.levels for part in parts),
            environment_size=lighting.environment.radiance.shape[1],
        ),
        effects=tuple(Effect(name=each.name, on=each.on, why=each.why) for each in fitted.planned.plan.decisions),
        time=clock.now(),
        inputs=loaded.inputs,
        tolerance=tuple(part.tolerance for part in parts if part.tolerance is not None) or None,
        nuisances=None if beside is None else beside.records,
        cameras=None if fitted.refined is None else fitted.refined.cameras,
    )
