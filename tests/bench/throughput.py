"""Samples a second of our integration of light, beside Mitsuba's of the same lobe and pixels, in turn in one run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.options.fidelity import preset
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.compute.threads import cores, one_thread_per_operation
from fit_material.renderer.environment.environment import Environment
from fit_material.renderer.environment.environment_file import read_environment
from fit_material.renderer.geometry.mesh import Sphere
from fit_material.renderer.light_kernel.llvm_integrator import LlvmIntegrator, fused_available
from fit_material.renderer.light_sampling.integrator import Integration, Integrator, LobeGrid
from fit_material.renderer.light_tables import light_table
from fit_material.renderer.light_tables.torch_integrator import TorchIntegrator
from fit_material.renderer.materials.bsdf import conductor
from fit_material.renderer.materials.catalogue import metal
from fit_material.renderer.mitsuba.conversion import envmap, mitsuba, mitsuba_shapes, sensor
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from tests.bench.photographs import map_of
from tests.bench.setting import spread

SIZE = 128  # pixels along a side: some more than the standard fit has
PRESETS = ("standard", "reference")  # whose numbers of samples are taken; torch only by the first's, for its time
INSCRIBED = 0.6  # half the picture's width in radii: every pixel sees the sphere, and none just its background
USUAL_REPEATS, MOST_REPEATS = 5, 20
LEVELS = (1, preset("standard").levels)
METAL, ALPHA, ENVIRONMENT = "Au", 0.2, "studio_small_03"

COUNTED = (
    "A sample is one pair of directions of one pixel, one drawn from the lobe and one from the light, both looked up,"
    " evaluated and weighed against each other by the balance heuristic.",
    "Ours: `microfacet_table`, half of `samples` from the lobe and half from the light, so `samples / 2` pairs a pixel;"
    " roughness levels this near share their pairs, which count once however many levels they are evaluated for."
    " Counted in its time: making the frames of 72 rays a pixel between the 16 that were traced, and 12 polynomials of"
    " the Fresnel curve × 3 channels × levels kept as sums; not: tracing those 16 rays, which a fit does once.",
    "Mitsuba: `direct` with one emitter sample and one BSDF sample, so one pair for each sample a pixel; counted in its"
    " time: a camera ray and two shadow rays against the one sphere, and 3 channels kept.",
)


@dataclass(frozen=True)
class Case:
    """A metal sphere that fills the picture, and how it is integrated.

    Attributes:
        size: of the picture, pixels along a side.
        pairs: of directions per pixel, even.
        environment: the light.
    """

    size: int
    pairs: int
    environment: Environment

    @property
    def samples(self) -> int:
        """Pairs drawn for all pixels together."""
        return self.size**2 * self.pairs

    @property
    def camera(self) -> Camera:
        origin, target, up = (torch.tensor(each, dtype=torch.float64) for each in ((0, 0, 4), (0, 0, 0), (0, 1, 0)))
        return Camera(look_at(origin, target, up), self.size, self.size, "orthographic", scale=INSCRIBED)

    @property
    def surface(self) -> GBuffer:
        """Of all pixels, row by row."""
        row, column = torch.meshgrid(torch.arange(self.size), torch.arange(self.size), indexing="ij")
        side = preset("standard").footprint
        return gbuffer.pixel_footprints(
            gbuffer.tracer(Sphere()), self.camera, column.flatten(), row.flatten(), side=side
        )

    @property
    def material(self) -> Metal:
        known = metal(METAL)
        n, k, alpha = (torch.tensor(each, dtype=torch.float64) for each in (known.n, known.k, ALPHA))
        return Metal(n, k, Microfacet(alpha))


@dataclass(frozen=True)
class Way:
    """One way to integrate.

    Attributes:
        name: for people.
        levels: of roughness that a pair is evaluated for.
        run: does it, given a seed; ways of one name and as many levels are one, whatever they are run on.
    """

    name: str
    levels: int
    run: Callable[[int], object] = field(compare=False)


@dataclass(frozen=True)
class Taken:
    """Seconds by the clock, and of all cores together, which a busy machine changes less."""

    seconds: float
    cpu: float


def rows(variant: str, repeats: int = USUAL_REPEATS) -> Iterator[str]:
    """Lines of Markdown tables, and of what is counted."""
    repeats, light = min(repeats, MOST_REPEATS), read_environment(map_of(ENVIRONMENT))
    yield f"{METAL}, GGX, alpha {ALPHA:g}, sphere in {ENVIRONMENT}; {SIZE}² pixels."
    yield from COUNTED
    yield f"{cores()} cores; every way run once beforehand, then {repeats} times in turn; median (range)."
    cases = [Case(SIZE, preset(name).samples // 2, light) for name in PRESETS]
    found = []
    for name, case in zip(PRESETS, cases, strict=True):
        yield ""
        yield f"{case.pairs} pairs a pixel, as the {name} preset has them:"
        yield ""
        found.append(in_turn(ways(case, variant, slow=case is cases[0]), repeats))
        yield from table(found[-1], case.samples)
    yield ""
    yield f"What pairs {cases[0].pairs + 1} to {cases[-1].pairs} cost, without what a pixel costs:"
    yield ""
    yield from further(found[0], found[-1], cases[-1].samples - cases[0].samples)
    yield ""
    if not fused_available():
        yield "The fused kernel needs LLVM's library, which is not found here."
    if not torch.cuda.is_available():
        yield "`--device cuda`: absent, torch finds no GPU here."
    yield f"Mean radiance, ours over Mitsuba's: {agreement(cases[0], variant):.4f}."


def table(found: Mapping[Way, Sequence[Taken]], samples: int) -> Iterator[str]:
    """Every way beside the first."""
    yield "| way | levels | s | CPU s | 10⁶ samples/s | over Mitsuba's | … by CPU s | … evaluations of all levels |"
    yield "|---|---|---|---|---|---|---|---|"
    rival = next(iter(found.values()))
    for way, taken in found.items():
        yield _row(way, taken, rival, samples)


def further(few: Mapping[Way, Sequence[Taken]], many: Mapping[Way, Sequence[Taken]], samples: int) -> Iterator[str]:
    """The same of what `many` took beyond `few`, for so many samples more; of the ways that both have."""
    taken = {
        way: [Taken(b.seconds - a.seconds, b.cpu - a.cpu) for a, b in zip(few[way], many[way], strict=True)]
        for way in many
    }
    yield from table(taken, samples)


def ways(case: Case, variant: str, slow: bool) -> list[Way]:
    """Mitsuba's and ours; the slow ones, too, if wanted."""
    on_gpu = by_torch(case, "cuda") if torch.cuda.is_available() else []
    return [mitsubas(case, variant), *by_kernel(case), *(by_torch(case, "cpu") if slow else ()), *on_gpu]


def by_kernel(case: Case) -> list[Way]:
    """The compiled kernel on the CPU, where there is LLVM."""
    here = LEVELS if fused_available() else ()
    return [Way("ours, fused kernel", levels, _integration(case, levels, LlvmIntegrator())) for levels in here]


def by_torch(case: Case, device: str) -> list[Way]:
    """Torch on a device; the table ends on the CPU, so that all work is done by then."""
    there = replace(case, environment=replace(case.environment, radiance=case.environment.radiance.to(device)))
    return [Way(f"ours, torch, {device}", levels, _integration(there, levels, TorchIntegrator())) for levels in LEVELS]


def _integration(case: Case, levels: int, integrator: Integrator) -> Callable[[int], object]:
    fidelity, surface = preset("standard"), case.surface
    factor = fidelity.spans[-1] if levels > 1 else 1.001
    light = replace(case.environment, radiance=case.environment.radiance.float())

    def run(seed: int) -> object:
        with one_thread_per_operation():
            return light_table.microfacet_table(
                surface,
                light,
                LobeGrid(ALPHA / factor, ALPHA * factor, levels, "ggx"),
                Integration(fidelity.degree, 2 * case.pairs, seed),
                integrator=integrator,
            )

    return run


def mitsubas(case: Case, variant: str) -> Way:
    """The same pixels by Mitsuba's `direct` integrator; all samples in one launch, no slower than in four."""
    return Way(f"Mitsuba, {variant}", 1, mitsuba_picture(case, variant))


def mitsuba_picture(case: Case, variant: str) -> Callable[[int], Float[np.ndarray, "h w 4"]]:
    """From a seed to its picture."""
    mi: Any = mitsuba(variant)
    known = metal(METAL)
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 1},
            "sensor": sensor(case.camera),
            "light": envmap(case.environment),
            **mitsuba_shapes(Sphere(), [conductor(known.n, known.k, ALPHA)]),
        }
    )
    return lambda seed: np.array(mi.render(scene, spp=case.pairs, seed=seed))


def in_turn(ways: Sequence[Way], repeats: int) -> Mapping[Way, list[Taken]]:
    """What each way takes; each repeat goes through all, so that they meet the same machine."""
    for way in ways:
        way.run(0)  # compiles
    taken: dict[Way, list[Taken]] = {way: [] for way in ways}
    for seed in range(1, repeats + 1):
        for way in ways:
            begun, busy = time.perf_counter(), time.process_time()
            way.run(seed)
            taken[way].append(Taken(time.perf_counter() - begun, time.process_time() - busy))
    return taken


def _row(way: Way, own: Sequence[Taken], rivals: Sequence[Taken], samples: int) -> str:
    seconds, cpu = ([getattr(each, key) for each in own] for key in ("seconds", "cpu"))
    by_clock, by_cpu = (ratios(own, rivals, key) for key in ("seconds", "cpu"))
    evaluated = spread([way.levels * ratio for ratio in by_clock])
    cells = (seconds, cpu, [samples / each / 1e6 for each in seconds], by_clock, by_cpu)
    return f"| {way.name} | {way.levels} | {' | '.join(map(spread, cells))} | {evaluated} |"


def ratios(own: Sequence[Taken], rivals: Sequence[Taken], key: str) -> list[float]:
    """Of our samples a second to the rival's, repeat by repeat."""
    return [getattr(rival, key) / getattr(each, key) for each, rival in zip(own, rivals, strict=True)]


def agreement(case: Case, variant: str) -> float:
    """Mean radiance of our picture over that of Mitsuba's: 1, up to noise, where both integrate the same."""
    own = Lighting(case.environment, (), preset("standard")).radiance(case.material, case.surface, 2 * case.pairs)
    return float(own.mean() / mitsuba_picture(case, variant)(0)[..., :3].mean(dtype=float))
