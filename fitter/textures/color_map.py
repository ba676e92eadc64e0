"""The colour texture of a material: solved for from all photographs, filled, padded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.fitted.color_texture import CLEARLY_ABOVE, MANY_CUT, ColorMap
from fit_material.fitter.fitted.part import FittedPart
from fit_material.fitter.fitted.planned import PlannedFit
from fit_material.fitter.forward.received_light import Albedo, DiffuseLight, Met
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.result.schema import FittedMaterial, Intervals
from fit_material.fitter.textures.radiosity import DARK
from fit_material.fitter.textures.texel_equations import TexelEquations, radiosity_on, rows
from fit_material.fitter.textures.texel_solver import solve, texture_size
from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.images.textures import Texture, lookup
from fit_material.renderer.rays.gbuffer import Tracer
from fit_material.renderer.rays.uv_atlas import Unwrapped, filled, overlap, unwrapped
from fit_material.shaders.materials.kinds import KINDS

SMALLEST, LARGEST = 16, 4096  # texels along a side
ROUNDS = 3  # of light that the object sends itself, and of the texture in it: each errs by a tenth of the last
OVERLAPS = (
    1.05  # places that share a texel in the mean, from which that is reported; by centres it is known to a hundredth
)
LEAST_MEAN = 1e-3  # of a channel's texels, below which a tint would only be rounding


def with_color_maps(
    planned: PlannedFit, loaded: Loaded, trace: Tracer, progress: Progress, *, seed: int, interreflection: bool
) -> PlannedFit:
    """The fit with the textures of its parts' bodies; those of metal as they were.

    Args:
        planned: the fit.
        loaded, trace: its scene.
        progress: called with the stage and the fraction of it done.
        seed: of the places from which light is sent.
        interreflection: whether to count light that the object sends itself.
    """
    parts, plan = list(planned.parts), planned.plan
    for place, part in enumerate(parts):
        parts[place] = _with_color_map(part, parts, loaded, trace, progress, seed, interreflection)
    if any("interreflection" in part.lighting.effects for part in parts if part.color_map is not None):
        plan = plan.with_on("interreflection", "colour maps count it, as diffuse light")
    return replace(planned, parts=parts, plan=plan)


def _with_color_map(
    part: FittedPart,
    parts: Sequence[FittedPart],
    loaded: Loaded,
    trace: Tracer,
    progress: Progress,
    seed: int,
    interreflection: bool,
) -> FittedPart:
    """The part with its texture, in the light that parts with theirs and without send it."""
    if not KINDS[part.material.type].has_body:
        return part.remarked("Metals have no body to be coloured, and no colour map.")
    assert isinstance(loaded.shape, Mesh)
    progress("colour map", 0)
    where = (loaded.photographs, trace, sorted(loaded.repeated))
    places = radiosity_on(part, *where, interreflection, seed)
    found = rows(part, *where, places, lambda share: progress("colour map", share))
    if not any((each.area > 0).any() for each in found):
        return _unmapped(part, "Its faces have no texture coordinates, or such as cover no area")
    size = texture_size(found, SMALLEST, LARGEST)
    layout = unwrapped(loaded.shape, part.index, size, size)
    light = None if places is None else places.light()
    made = _color_map(part, found, light, layout)
    if made is None:
        return _unmapped(part, f"By its texture coordinates no pixel separates texels, {size} a side")
    effects, counted = part.lighting.effects - {"interreflection"}, ""
    if places is not None and places.transfer is not None:
        for _ in range(ROUNDS):
            light = places.light(_albedo(replace(part, color_map=made), parts))
            made = _color_map(part, found, light, layout) or made
        effects, counted = effects | {"interreflection"}, _on_returned(found, light)
    lighting = replace(part.lighting, color_map=_tint(part, made), received=light, effects=effects)
    part = replace(part, material=_recolored(part.material, made), lighting=lighting, color_map=made)
    return part.remarked(f"{_on_spots(part)}{made.sentence}{counted}{_on_overlaps(loaded.shape, part.index, layout)}")


def _unmapped(part: FittedPart, why: str) -> FittedPart:
    """The part without a map, whose even colour is that of some places alone."""
    known = part.material.determined.model_copy(update={"color": (False, False, False)})
    part = replace(part, material=part.material.model_copy(update={"determined": known}))
    return part.remarked(f"{why}: there is no colour map of it, and its colour is some places' mean.")


def _color_map(
    part: FittedPart, found: Sequence[TexelEquations], light: DiffuseLight | None, layout: Unwrapped
) -> ColorMap | None:
    """The texture by which the photographs come nearest in this light; None where they determine none of its texels."""
    solution = solve(found, len(layout.inside), _color(part).clamp_min(LEAST_MEAN).numpy(), light)
    if not solution.solved.any():
        return None
    color = filled(solution.color, solution.solved, layout)
    photographs = np.where(layout.inside, solution.photographs, 0)
    seen = photographs > 0
    cut = np.count_nonzero(seen & (color > CLEARLY_ABOVE).any(-1)) / max(1, np.count_nonzero(seen))
    return ColorMap(np.clip(color, 0, 1), photographs, solution.scatter, cut)


def _tint(part: FittedPart, made: ColorMap) -> Texture:
    """The map over the colour that was fitted."""
    return Texture(torch.from_numpy(made.color / _color(part).clamp_min(LEAST_MEAN).numpy()))


def _color(part: FittedPart) -> Float[Tensor, "3"]:
    """Of the material fitted, which has a body."""
    color = part.choice.fit.material.color
    assert color is not None
    return color


def _albedo(part: FittedPart, parts: Sequence[FittedPart]) -> Albedo:
    """What the object sends back: each material in the colours found so far, one without a fit as the others' mean."""
    known = {each.index: part if each.index == part.index else each for each in parts}

    def sent(met: Met) -> Float[np.ndarray, "m 3"]:
        found, fitted = torch.zeros(len(met.material), 3, dtype=torch.float64), torch.zeros(len(met.material)).bool()
        for index, each in known.items():
            own, material = met.material == index, each.choice.fit.material
            if each.color_map is not None:
                color = lookup(Texture(torch.from_numpy(each.color_map.color)), met.uv[own]).double()
                material = material.with_color(color)
            found[own] = material.albedo(each.lighting.fidelity.distribution)
            fitted |= own
        if not fitted.all() and fitted.any():
            found[~fitted] = found[fitted].mean(0)
        return found.numpy()

    return sent


def _on_spots(part: FittedPart) -> str:
    if part.observed.point is not None:
        return ""
    return (
        "Hardly any place is seen by two photographs: what the material mirrors was fitted as if its colour were even. "
    )


def _on_returned(found: Sequence[TexelEquations], light: DiffuseLight | None) -> str:
    """How much of its light the object sends itself, where it is seen."""
    if light is None:
        return ""
    alone = replace(light, returned=0 * light.returned)
    whole, direct = (np.concatenate([each.body(which) for each in found]).mean(1) for which in (light, alone))
    share = 1 - direct / np.maximum(whole, DARK)
    return (
        f" Of its diffuse light {share.mean():.1%} came from the object itself, in 5 % of the pixels"
        f" {np.quantile(share, 0.95):.1%} or more; none of that is taken for colour."
    )


def _on_overlaps(mesh: Mesh, material: int, layout: Unwrapped) -> str:
    """Whether several places share a texel."""
    times = overlap(mesh, material, layout)
    if times < OVERLAPS:
        return ""
    return f" Its texture coordinates overlap: {times:.1f} places of the surface share a texel and its one colour."


def _recolored(material: FittedMaterial, made: ColorMap) -> FittedMaterial:
    """The material with the mean of its texture for its colour; intervals move along.

    Where many texels were cut at 1 it is not determined.
    """
    mean, moved, known = made.mean, None, material.determined
    if made.cut > MANY_CUT:
        known = known.model_copy(update={"color": (False, False, False)})
    if material.interval95.color is not None and material.color is not None:
        moved = tuple(
            None if each is None else tuple(float(np.clip(end + new - old, 0, 1)) for end in each)
            for each, new, old in zip(material.interval95.color, mean, material.color, strict=True)
        )
    intervals: Intervals = material.interval95.model_copy(update={"color": moved})
    return material.model_copy(update={"color": mean, "interval95": intervals, "determined": known})
