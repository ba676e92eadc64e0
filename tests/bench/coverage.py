"""How often 95 % intervals hold the truth: noise drawn again and again, every draw fitted in this process.

The choice of pixels and the integration draw anew each time, too: their errors are part of what intervals promise.
So are photographs traced anew where noise is added to them: what they have of their own is small beside it on average,
but not where a pixel mirrors a lamp, and of one photograph it would stand in every draw as if it were a bias.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float

from fit_material.fitter.forward.lighting import lighting_for
from fit_material.fitter.observations.album import Album
from fit_material.fitter.observations.scene_data import load
from fit_material.fitter.pipeline.fit_materials import fit_parts
from fit_material.renderer.compute.threads import one_thread_per_operation
from fit_material.renderer.files.atomic import write_bytes_atomically
from fit_material.renderer.rays import gbuffer
from tests.bench.estimates import Estimate, estimate_of, true_numbers
from tests.bench.fits import How, in_processes
from tests.bench.grid import NAMES, NOISE, SPP, Selection, share
from tests.bench.noise import pictures_of
from tests.bench.photographs import Case

SIZE = 64
CASES = (Case("Au", 0.2, "studio_small_03", size=SIZE), Case("Fe", 0.1, "rooitou_park", size=SIZE))
SAMPLES = {"added": SPP, "traced": 256}  # a pixel: as in the grid that noise is added to; and as much noise as that
MOST = 200  # renders that are kept
SEED = 40_000


@dataclass(frozen=True)
class Draws:
    """One case photographed again and again: with normal noise added each time, or traced by other paths."""

    case: Case
    kind: Literal["added", "traced"]
    variant: str
    how: How

    @property
    def title(self) -> str:
        noise = f"Mitsuba's, {SAMPLES[self.kind]} spp"
        return f"{self.case.label} | {noise}" + (f", and {NOISE:.0%} added" if self.kind == "added" else "")


def rows(variant: str, selection: Selection) -> Iterator[str]:
    """Lines of a Markdown table."""
    yield f"Sphere, 3 views of {SIZE}², {selection.repeats} draws; {selection.how}."
    yield "Share of intervals that hold the truth ± binomial error; mean and root mean square of error over stated σ."
    yield ""
    yield "| case | noise | number | in 95 % interval | mean error/σ | rms error/σ |"
    yield "|---|---|---|---|---|---|"
    kinds: tuple[Literal["added", "traced"], ...] = ("added", "traced")
    for case in CASES:
        for kind in kinds:
            yield from _table(Draws(case, kind, variant, selection.how), selection)


def _table(draws: Draws, selection: Selection) -> Iterator[str]:
    _photographs(draws)  # before there are several processes
    found = list(in_processes(partial(_fitted, draws), range(min(selection.repeats, MOST)), selection.jobs))
    truth = true_numbers(draws.case)
    holds = np.stack([each.holds(truth) for each in found])
    deviations = np.stack([each.deviation(truth) for each in found])
    for index, name in enumerate(NAMES):
        yield f"| {draws.title} | {name} | {share(holds[:, index])} | {_moments(deviations[:, index])} |"
    yield f"| {draws.title} | **all** | {share(holds)} | {_moments(deviations)} |"


def _moments(deviations: np.ndarray) -> str:
    return f"{np.nanmean(deviations):+.2f} | {np.nanmean(deviations**2) ** 0.5:.2f}"


def _fitted(draws: Draws, index: int) -> Estimate:
    """The fit of one draw."""
    scene = draws.case.scene(draws.variant)
    loaded = load(scene)
    drawn = _draw(draws, index)
    photographs = Album.of(
        replace(photograph, radiance=torch.from_numpy(pixels))
        for photograph, pixels in zip(loaded.photographs, drawn, strict=True)
    )
    options = draws.how.options(seed=index)
    lighting = lighting_for(loaded, options, torch.device("cpu"))
    trace = gbuffer.tracer(loaded.shape)
    with one_thread_per_operation():
        again = replace(loaded, photographs=photographs)
        (part,) = fit_parts(again, trace, lighting, options, lambda stage, done: None, scene)
    return estimate_of(part.material)


def _draw(draws: Draws, index: int) -> Float[np.ndarray, "v h w 3"]:
    traced = _photographs(draws)[index]
    if draws.kind == "traced":
        return traced
    noise = np.random.default_rng([SEED, index]).normal(size=traced.shape)
    return (traced * (1 + NOISE * noise)).astype(np.float32)


@lru_cache(maxsize=1)
def _photographs(draws: Draws) -> Float[np.ndarray, "d v h w 3"]:
    """All traced photographs; those of an earlier run where they are kept."""
    samples = SAMPLES[draws.kind]
    kept = draws.case.measured(f"traced-{MOST}x{samples}", draws.variant)
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        views = pictures_of(draws.case, draws.variant, [samples] * MOST, SEED + samples)
        file = io.BytesIO()
        np.savez(file, pixels=np.stack([np.stack([picture[..., :3] for picture in view]) for view in views], 1))
        write_bytes_atomically(kept, file.getvalue())
    with np.load(kept) as found:
        return found["pixels"]
