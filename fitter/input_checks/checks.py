"""All findings about a scene, in the order in which one would mend them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from fit_material.fitter.input_checks.candidate_pictures import CoarseLight
from fit_material.fitter.input_checks.duplicates import duplicate_findings, rows_of
from fit_material.fitter.input_checks.finding import Finding, percent
from fit_material.fitter.input_checks.hypotheses import Hypothesis, HypothesisTest, NuisanceFactors
from fit_material.fitter.input_checks.lighting import Named, darkness_findings, findings, steps, turning
from fit_material.fitter.input_checks.orientation import GIVEN, Orientation, upright
from fit_material.fitter.input_checks.pixel_values import pixel_findings
from fit_material.fitter.input_checks.sampled_pixels import look
from fit_material.fitter.input_checks.sharpness import sharpness_finding
from fit_material.fitter.input_checks.silhouette import MeshTurn, Sighting, mesh_turn, silhouette_findings, turned
from fit_material.fitter.observations.album import KEPT, Album
from fit_material.fitter.observations.photograph import Photograph
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import ENDINGS
from fit_material.renderer.rays.gbuffer import Tracer
from fit_material.renderer.scene.fittable_values import FITTED
from fit_material.renderer.scene.lights import light_of
from fit_material.renderer.scene.scene_file import PhotographSpec

MOST = 8  # photographs that a coarse fit looks at
FLOATS = (".exr", ".hdr", ".npy", *ENDINGS)


@dataclass(frozen=True)
class Lit:
    """Results of a coarse fit: how the world lies in the map, and its findings."""

    orientation: Orientation
    findings: tuple[Finding, ...]


def preflight(loaded: Loaded, trace: Tracer, scene_file: Path, seed: int = 0, most: int | None = None) -> list[Finding]:
    """What is wrong with a scene's input.

    Args:
        loaded: the scene.
        trace: of its object.
        scene_file: for the sentences.
        seed: of the choice of pixels and of the integration.
        most: photographs to look at, evenly drawn; None for all. The coarse fit looks at `MOST` of them.

    Raises:
        InputError: a photograph cannot be read.
    """
    numbers = _evenly(range(len(loaded.photographs)), most)
    found: list[Finding] = []
    sightings, rows, names = [], [], []
    for number in numbers:
        photograph = loaded.photographs[number]
        where = f"photographs[{number}] ({photograph.name})"
        sighting = Sighting.of(photograph, trace)
        inside = sighting.inside(photograph)
        found += pixel_findings(photograph, inside, where)
        blurred = sharpness_finding(photograph, inside, where)
        found += [blurred] if blurred is not None else []
        sightings.append(sighting)
        rows.append(rows_of(photograph))
        names.append(where)
    found += duplicate_findings(rows, names)
    turn = mesh_turn(sightings, trace)
    if turn is not None:
        trace = turned(trace, turn.matrix)
        sightings = [each.by(trace) for each in sightings]
    lost = silhouette_findings(sightings, names)
    seen = [i for i in range(len(numbers)) if not any(each.where == names[i] for each in lost)]
    lit = _light(loaded, [numbers[i] for i in _evenly(seen, MOST)], trace, scene_file, seed)
    return [*up_axes(turn, lit), *lost, *found]


def affordable(photographs: Album) -> int:
    """How many photographs a fit may look at beforehand: those that its album keeps are read for both."""
    first = photographs[0]
    return max(2, min(MOST, KEPT // (first.radiance.nbytes + first.mask.nbytes)))


def _evenly(numbers: Sequence[int], most: int | None) -> list[int]:
    """At most so many of them, from first to last."""
    if most is None or len(numbers) <= most:
        return list(numbers)
    return [numbers[round(i * (len(numbers) - 1) / max(1, most - 1))] for i in range(most)]


def _light(loaded: Loaded, numbers: Sequence[int], trace: Tracer, scene_file: Path, seed: int) -> Lit:
    """What a coarse fit finds."""
    if not numbers:
        return Lit(GIVEN, ())
    try:
        looks = look(loaded.photographs, numbers, trace, scene_file, len(loaded.materials), seed)
    except InputError as error:
        none = Finding("silhouette", error.field, "0 pixels that can be fitted", f"there has to be {error.expected}")
        return Lit(GIVEN, (none,))
    sources = [light_of(light) for light in loaded.scene.lights]
    light = CoarseLight.of(loaded.environment, sources)
    linear = [_is_linear(loaded.scene.photographs[number]) for number in numbers]
    tribunal = HypothesisTest(looks, light, torch.tensor(linear), seed)
    called = [_named(number, loaded.photographs[number]) for number in numbers]
    start = Hypothesis(gains=_gains(loaded, called))
    found = steps(tribunal, start)
    orientation = found[-1].after.orientation if found else GIVEN
    told = findings(found, called, tribunal)
    if start.gains == "as said" and not any(each.kind == "exposure" for each in told):
        told += darkness_findings(tribunal)
    return Lit(orientation, tuple(told))


def _gains(loaded: Loaded, called: Sequence[Named]) -> NuisanceFactors:
    """Which exposures are left to the fit; the environment's scale is one for all."""
    if any(each.exposure is None for each in called):
        return "each"
    return "all" if FITTED in (loaded.scene.exposure, loaded.scene.environment.scale) else "as said"


def _named(number: int, photograph: Photograph) -> Named:
    return Named(number, photograph.name, photograph.exposure)


def _is_linear(spec: PhotographSpec) -> bool:
    """Whether the pixels are declared to be linear."""
    if spec.encoding is not None:
        return spec.encoding == "linear"
    return spec.image.suffix.lower() in FLOATS


def up_axes(turn: MeshTurn | None, lit: Lit) -> list[Finding]:
    """Findings about the light, beside those about a mesh that has to be rotated.

    Cameras that are z-up show as both: against them the mesh lies wrong, and so does the light.
    """
    if turn is None:
        return list(lit.findings)
    value = f"the mesh's silhouettes overlap the masks by {percent(turn.before)} (IoU), turned by {percent(turn.after)}"
    if not turn.by_outline:
        edges = f"{percent(turn.before)} of the picture, turned on such of {percent(turn.after)}"
        value = f"the mesh's silhouettes lie on edges stronger than those of {edges}"
    up = lit.orientation.up
    if torch.equal((upright(up) @ turn.matrix).round(), torch.eye(3, dtype=torch.float64)):
        others = [each for each in lit.findings if each.kind != "up-axis"]
        told = "; ".join([value, *(f"light {each.value}" for each in lit.findings if each.kind == "up-axis")])
        remedy = f"turn the cameras so that their {up} becomes +Y: {turning(up)}"
        return [Finding("up-axis", "photographs' cameras against mesh and environment", told, remedy), *others]
    remedy = f"turn the mesh so that its {turn.up} becomes +Y" if turn.up != "+Y" else "turn the mesh"
    remedy += f", then by {turn.turn}° about +Y" if turn.turn else ""
    return [Finding("up-axis", "geometry.mesh against photographs' cameras", value, remedy), *lit.findings]
