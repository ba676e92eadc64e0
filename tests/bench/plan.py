"""What planning brings: fits by the plan beside fits by hand and with everything on, and what each effect costs."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import torch

from fit_material.fitter.effects.interreflection import SAMPLES as PATHS
from fit_material.fitter.effects.plan import Plan
from fit_material.fitter.effects.planner import Planner
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.options.fidelity import PRESETS
from fit_material.fitter.options.fit_options import FitOptions
from fit_material.fitter.pipeline.fit_scene import fit_scene
from fit_material.fitter.result.schema import Result
from fit_material.renderer.geometry.mesh import Mesh, Shape, Sphere, read_mesh
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.materials.bsdf import Bsdf, conductor, diffuse, plastic
from fit_material.renderer.path_tracing.differentiable_scene import DifferentiableScene
from fit_material.renderer.path_tracing.path_tracer import render
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.renderer.scene.lights import directional_light
from fit_material.renderer.synthesis.camera_placement import View, views
from fit_material.renderer.synthesis.scene_writer import scene_toml
from fit_material.shaders.effects import EFFECTS
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.optics.fresnel import normal_reflectance
from tests.support import bowl as golden
from tests.support.plan_scenes import LAMP, row_of_balls, torus, write_obj

SIZE, SPP = 64, 512
ALL = frozenset(EFFECTS)
FIDELITY = replace(PRESETS["standard"], pixels=1500, samples=512)
EVERYTHING = ("self-visibility", "interreflection", "ambient-occlusion", "light-reflection", "pixel-footprint")
REPEATS = 3  # of which the soonest counts: other processes only slow a fit down
ROUNDS = 7  # of paths that a polish traces: three, and some four until it settles
GOLD = conductor(golden.N, golden.K, golden.ALPHA)
F0 = normal_reflectance(torch.tensor(golden.N), torch.tensor(golden.K)).tolist()


@dataclass(frozen=True)
class Case:
    """A photographed object of one material."""

    name: str
    shape: Shape
    bsdf: Bsdf
    type: str
    lamp: bool = False
    looks: tuple[View, ...] = ()

    def photographed(self, folder: Path) -> Path:
        """Its scene.toml."""
        folder.mkdir(parents=True)
        mesh = write_obj(folder / "mesh.obj", self.shape) if isinstance(self.shape, Mesh) else None
        shape = self.shape if mesh is None else read_mesh(mesh)
        lights, poses = (LAMP,) if self.lamp else (), self.looks or views(3, shape)
        write_exr(folder / "environment.exr", golden.light().radiance.numpy())
        sources = [directional_light(light) for light in lights]
        for index, pose in enumerate(poses):
            options = {"lights": sources, "spp": SPP, "seed": index, "variant": "llvm_ad_rgb"}
            picture = render(shape, pose.camera(SIZE), golden.light(), self.bsdf, **options)
            write_exr(folder / f"view_{index}.exr", picture)
        (folder / "scene.toml").write_text(scene_toml(mesh, lights, poses), encoding="utf-8")
        return folder / "scene.toml"


BALL = Case("lonely ball", Sphere(), GOLD, "metal")
BOWL = Case("bowl", golden.bowl(), GOLD, "metal", looks=tuple(golden.looks()))
BALLS = Case("two balls", row_of_balls(2.2), GOLD, "metal")
SIMPLE = (
    Case("matte ball", Sphere(), diffuse((0.5, 0.3, 0.2)), "matte"),
    BALL,
    Case("ball with a lamp", Sphere(), GOLD, "metal", lamp=True),
    Case("glossy ball with a lamp", Sphere(), plastic((0.5, 0.3, 0.2), 0.04, 0.2, "ggx"), "glossy", lamp=True),
)


def rows(variant: str) -> Iterator[str]:
    """All three tables."""
    with tempfile.TemporaryDirectory() as folder:
        yield from cost_rows()
        yield ""
        yield from time_rows(Path(folder))
        yield ""
        yield from recovery_rows(Path(folder))


def cost_rows() -> Iterator[str]:
    """Seconds that effects take in the tables of a fit of 4000 pixels, or of what a polish traces."""
    surface = _pixels(torus())
    alpha, n, k = (torch.tensor(each, dtype=torch.float64) for each in (golden.ALPHA, golden.N, golden.K))
    plain = Lighting(golden.light(), (), PRESETS["standard"])
    lit = replace(plain, sources=(directional_light(LAMP),))
    hidden = replace(plain, occluder=Occluder.of(torus()))
    few = plain.simulating(ALL - {"pixel-footprint"})
    scene = DifferentiableScene(torus(), golden.light(), (), [GOLD])

    def table(lighting: Lighting) -> Callable[[], object]:
        return lambda: lighting.table(surface, (0.18, 0.22, 5), 512)

    lobe, middle_alone = _seconds(table(plain)), _seconds(table(few))
    body = _seconds(lambda: plain.pixels(surface, body=True))
    bare = _seconds(lambda: plain.pixels(surface, body=False))
    paths = _seconds(
        lambda: scene.radiance(surface, Metal(n, k, Microfacet(alpha)), samples=PATHS // 8, seed=0, beyond_direct=True)
    )
    lamp = [_seconds(lambda each=each: each.pixels(surface, False).under(None)) for each in (lit, plain)]
    found = {
        "reflection": _seconds(lambda: plain.simulating(ALL - {"blur"}).table(surface, (0.2, 0.2, 1), 1)),
        "blur": lobe,
        "light-reflection": max(0.0, lamp[0] - lamp[1]),
        "diffuse-irradiance": body - bare,
        "ambient-occlusion": _seconds(lambda: hidden.pixels(surface, body=True)) - body,
        "self-visibility": _seconds(table(hidden)) - lobe,
        "interreflection": paths * 8 * ROUNDS,
        "pixel-footprint": max(0.0, lobe - middle_alone),
    }
    yield "| effect | s | over blur's | in the list |"
    yield "|---|---|---|---|"
    for effect in EFFECTS.values():
        if effect.name in found:
            seconds = found[effect.name]
            yield f"| {effect.name} | {seconds:.3f} | {seconds / lobe:.2g} | {effect.cost:g} |"


def time_rows(folder: Path) -> Iterator[str]:
    """Fits by the plan, by hand and with everything on."""
    yield "| scene | on | planned, s | by hand, s | everything, s | planned / hand | everything / planned | off by |"
    yield "|---|---|---|---|---|---|---|---|"
    for case in SIMPLE:
        scene = case.photographed(folder / case.name)
        options = FitOptions(FIDELITY, type=case.type)
        fitted(scene, options)  # kernels are compiled once
        planned, planning = min((fitted(scene, options) for _ in range(REPEATS)), key=lambda each: each[0].time.total)
        with fixed(planning):
            by_hand = min((fitted(scene, options)[0] for _ in range(REPEATS)), key=lambda each: each.time.total)
        wanted = tuple(name for name in EVERYTHING if case.type == "metal" or name != "interreflection")
        everything, _ = fitted(scene, replace(options, wanted=wanted))
        seconds = [each.time.total for each in (planned, by_hand, everything)]
        on = len([each for each in planned.effects if each.on])
        told = " | ".join(f"{each:.1f}" for each in seconds)
        ratios = f"{seconds[0] / seconds[1]:.2f} | {seconds[2] / seconds[0]:.1f}"
        yield f"| {case.name} | {on} | {told} | {ratios} | {apart(planned, everything):.2g} |"


def recovery_rows(folder: Path) -> Iterator[str]:
    """Gold by the plan and without what the object does to itself."""
    yield "| scene | plan | F0 off by | alpha off by | n off by | k off by | s |"
    yield "|---|---|---|---|---|---|---|"
    off = ("self-visibility", "interreflection")
    for case in (BALL, BOWL, BALLS):
        scene = folder / case.name / "scene.toml"
        scene = scene if scene.exists() else case.photographed(folder / case.name)
        for name, unwanted in (("as planned", ()), ("without", off)):
            if case is BALL and unwanted:
                continue
            result, _ = fitted(scene, FitOptions(FIDELITY, type="metal", unwanted=unwanted))
            yield f"| {case.name} | {name} | {_errors(result)} | {result.time.total:.0f} |"


def fitted(scene: Path, options: FitOptions) -> tuple[Result, list[Plan]]:
    """The result, and the plans that were made for it."""
    made: list[Plan] = []
    plan = Planner.plan

    def kept(self: Planner, *arguments: object) -> Plan:
        made.append(plan(self, *arguments))  # type: ignore[arg-type]
        return made[-1]

    with tempfile.TemporaryDirectory() as out, patch.object(Planner, "plan", kept):
        return fit_scene(scene, Path(out), options, begun=time.perf_counter()), made


@contextmanager
def fixed(plans: list[Plan]) -> Iterator[None]:
    """Nobody looks at the scene: the plan is known."""
    with patch.object(Planner, "plan", lambda self, *arguments: plans[-1]):
        yield


def apart(one: Result, other: Result) -> float:
    """Largest difference of the determined numbers of two results, relative."""
    found = [0.0]
    first, second = one.materials[0], other.materials[0]
    for key in ("f0", "alpha", "color"):
        pair = [getattr(each, key) for each in (first, second)]
        if all(value is not None for value in pair):
            values = [value if isinstance(value, tuple) else (value,) for value in pair]
            found += [abs(a / b - 1) for a, b in zip(*values, strict=True) if b]
    return max(found)


def _errors(result: Result) -> str:
    found = result.materials[0]
    assert found.f0
    assert found.n
    assert found.k
    pairs = ((found.f0, F0), (found.n, golden.N), (found.k, golden.K))
    f0, n, k = (max(abs(a / b - 1) for a, b in zip(*pair, strict=True)) for pair in pairs)
    alpha = abs((found.alpha or 0) / golden.ALPHA - 1)
    return f"{f0:.2%} | {alpha:.2%} | {n:.1%} | {k:.1%}"


def _pixels(mesh: Mesh) -> GBuffer:
    """4000 pixels that the mesh covers wholly."""
    camera = views(1, mesh)[0].camera(128)
    row, column = gbuffer.pixel_centres(gbuffer.tracer(mesh), camera).front.nonzero().T
    surface = gbuffer.pixel_footprints(gbuffer.tracer(mesh), camera, column, row, 4)
    return surface[surface.front.all(-1)][:4000]


def _seconds(work: Callable[[], object]) -> float:
    """The least of three, the first of which may compile."""
    times = []
    for _ in range(3):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return min(times)
