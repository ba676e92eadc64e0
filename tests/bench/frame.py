"""What a picture costs in the GL viewer, and the same one in torch, both ready to draw."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import drjit
import numpy as np
import torch

from fit_material.renderer.materials.textured_material import Appearance
from fit_material.renderer.opengl.context import offscreen_context
from fit_material.renderer.opengl.drawing import Stage
from fit_material.renderer.opengl.targets import linear_target
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.synthesis.studio import studio
from fit_material.renderer.viewer_model import shading
from fit_material.renderer.viewer_model.viewer_light import Surroundings, surroundings
from fit_material.shaders.materials.types import made_of
from fit_material.shaders.materials.widths import Blur
from tests.bench.setting import spread
from tests.support import parity

SIZE, REPEATS = 512, 9
MATERIALS = ("metal", "glossy", "matte")
WAYS = ("GL", "GL, exact", "torch, rays", "torch, shading")
THREADS = "LP_NUM_THREADS"


@dataclass(frozen=True)
class Outcome:
    """Milliseconds of every repeat by way of drawing, and how many pixels the model covers."""

    milliseconds: Mapping[str, Sequence[float]]
    covered: int

    @property
    def torch(self) -> Sequence[float]:
        """Of whole pictures in torch."""
        return [rays + light for rays, light in zip(*(self.milliseconds[way] for way in WAYS[2:]), strict=True)]

    def ratio(self, way: str) -> Sequence[float]:
        """Of torch's time to that of a way to draw, repeat by repeat."""
        return [slow / fast for slow, fast in zip(self.torch, self.milliseconds[way], strict=True)]


def rows(variant: str) -> Iterator[str]:
    """Lines of a Markdown table."""
    with _as_many_threads() as threads:
        far, renderer = surroundings(studio(256)), offscreen_context().info["GL_RENDERER"]
        yield f"Torus under one light, {SIZE}², {REPEATS} repeats in turn, median (range)."
        yield f"{renderer}: {THREADS}={threads}; torch in float32, its rays by Mitsuba: {threads} thread(s)."
        yield "Uploads, compilation and acceleration structures are made before; GL's picture is read back."
        yield ""
        yield "| material | pixels | GL, ms | exact, ms | torch: rays + shading, ms | torch / GL | torch / exact |"
        yield "|---|---|---|---|---|---|---|"
        for material in MATERIALS:
            yield _row(material, _outcome(parity.Case(material, light=True), far))


@contextmanager
def _as_many_threads() -> Iterator[int]:
    """Torch and Mitsuba get as many threads as llvmpipe, which has read how many when its context was made."""
    threads, before = int(os.environ.get(THREADS, os.cpu_count() or 1)), (torch.get_num_threads(), drjit.thread_count())
    torch.set_num_threads(threads)
    drjit.set_thread_count(threads)
    try:
        yield threads
    finally:
        torch.set_num_threads(before[0])
        drjit.set_thread_count(before[1])


def _outcome(case: parity.Case, far: Surroundings) -> Outcome:
    light = case.surroundings(far)
    drawings = {**_by_gl(case, light), **_by_torch(case, light)}
    for draw in drawings.values():
        draw()  # compiles, and touches the memory
    times: dict[str, list[float]] = {way: [] for way in drawings}
    for _ in range(REPEATS):
        for way, draw in drawings.items():
            times[way].append(_milliseconds(draw))
    return Outcome(times, int((np.asarray(drawings["GL"]())[..., 3] == 1).sum()))


def _by_gl(case: parity.Case, light: Surroundings) -> dict[str, Callable[[], object]]:
    context, camera = offscreen_context(), parity.camera(SIZE)
    target = linear_target(context, (SIZE, SIZE))

    def drawing(exact: bool) -> Callable[[], object]:
        stage = Stage(context, case.model(), light, exact=exact)

        def draw() -> np.ndarray:
            stage.draw(target, camera, sky=False)
            return np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(SIZE, SIZE, 4)

        return draw

    return {way: drawing(way == "GL, exact") for way in WAYS[:2]}


def _by_torch(case: parity.Case, light: Surroundings) -> dict[str, Callable[[], object]]:
    model, camera = case.model(), parity.camera(SIZE)
    appearances = [_single(appearance) for appearance in model.appearances]
    lights = shading.illuminations(model.mesh, appearances, light)
    trace = gbuffer.tracer(model.mesh)
    surface = gbuffer.pixel_centres(trace, camera)
    return {
        "torch, rays": lambda: gbuffer.pixel_centres(trace, camera),
        "torch, shading": lambda: shading.shade_surface(surface, appearances, lights),
    }


def _single(appearance: Appearance) -> Appearance:
    """The same in float32, in which GL computes."""
    material = appearance.material
    single = made_of(
        material.type,
        lambda quantity: getattr(material, quantity.name).float(),
        lambda: Blur(material.width.value.float()),
    )
    return Appearance(single, appearance.maps)


def _milliseconds(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    with torch.no_grad():
        work()
    return 1e3 * (time.perf_counter() - begun)


def _row(material: str, outcome: Outcome) -> str:
    gl, exact = (spread(outcome.milliseconds[way]) for way in WAYS[:2])
    rays, light = (f"{statistics.median(outcome.milliseconds[way]):.3g}" for way in WAYS[2:])
    ratios = " | ".join(spread(outcome.ratio(way)) for way in WAYS[:2])
    return (
        f"| {material} | {outcome.covered} | {gl} | {exact} | {rays} + {light} = {spread(outcome.torch)} | {ratios} |"
    )
