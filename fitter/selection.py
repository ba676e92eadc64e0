"""Which pixels are fitted, and the surface that each of them sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitter.photographs import Photograph
from renderer import gbuffer
from renderer.errors import InputError
from renderer.gbuffer import GBuffer, Tracer
from renderer.visibility import sees_itself

ANGLE_BINS = 16
CANDIDATES = 4  # per pixel that is wanted, so that the rare grazing ones are among them


@dataclass(frozen=True)
class Observations:
    """Pixels chosen for the fit.

    Attributes:
        surface: [p, k] rays inside each pixel.
        radiance: what the photographs show there, float64.
        self_seeing: share of the candidates that mirror the object itself.
    """

    surface: GBuffer
    radiance: Float[Tensor, "p 3"]
    self_seeing: float


def choose_pixels(
    photographs: Sequence[Photograph], trace: Tracer, scene_file: Path, *, count: int, footprint: int, seed: int
) -> Observations:
    """At most `count` pixels, spread evenly over the angles at which the surface is seen.

    Only near grazing angles does reflectance tell n from k, and a photograph has few pixels there; an even spread
    keeps them. Pixels whose footprint leaves the front of the object are never taken; those that mirror the object
    itself only where a photograph has no others.

    Args:
        photographs: each contributes the same number of pixels, as far as it has them.
        trace: of the object.
        scene_file: for the error's sentence.
        count: pixels wanted, over all photographs.
        footprint: rays along each side of a pixel.
        seed: of the choice among many.

    Raises:
        InputError: a camera sees nothing of the object where its mask is, or sees it from inside.
    """
    generator = torch.Generator().manual_seed(seed)
    quota = -(-count // len(photographs))
    parts = [
        _observe(photograph, trace, (scene_file, f"photographs[{i}].camera"), quota, footprint, generator)
        for i, photograph in enumerate(photographs)
    ]
    return Observations(
        gbuffer.concatenate([part.surface for part in parts])[:count],
        torch.cat([part.radiance for part in parts])[:count],
        sum(part.self_seeing for part in parts) / len(parts),
    )


def _observe(
    photograph: Photograph,
    trace: Tracer,
    place: tuple[Path, str],
    quota: int,
    footprint: int,
    generator: torch.Generator,
) -> Observations:
    pixels = photograph.mask.nonzero()
    pixels = pixels[torch.randperm(len(pixels), generator=generator)[: CANDIDATES * quota]]
    centres = gbuffer.pixel_footprints(trace, photograph.camera, pixels[:, 1], pixels[:, 0], 1)[:, 0]
    _require_front(centres, place)
    pixels, centres = pixels[centres.front], centres[centres.front]
    mirrors_itself = sees_itself(trace, centres)
    usable = ~mirrors_itself if not mirrors_itself.all() else mirrors_itself
    pixels, n_dot_v = pixels[usable], centres.n_dot_v[usable]
    pixels = pixels[_evenly_by_angle(n_dot_v, quota + quota // 8)]  # some will not be whole
    surface = gbuffer.pixel_footprints(trace, photograph.camera, pixels[:, 1], pixels[:, 0], footprint)
    whole = surface.front.all(-1)
    if not whole.any():
        raise InputError(*place, value="", expected="a pixel that the object covers wholly; come nearer")
    row, column = pixels[whole][:quota].T
    radiance = photograph.radiance[row, column].double()
    return Observations(surface[whole][:quota], radiance, float(mirrors_itself.double().mean()))


def _require_front(centres: GBuffer, place: tuple[Path, str]) -> None:
    if not centres.hit.any():
        expected = (
            f"a camera that sees the object in the pixels its photograph shows, but none of {len(centres.hit)} tried"
            " meets it: the object is outside the frame, or pose or field of view are wrong"
        )
        raise InputError(*place, value="", expected=expected)
    if not centres.front.any():
        expected = (
            "a camera outside the object, but every ray meets the back of its surface:"
            " the camera is inside the object, or the mesh's faces are wound inside out"
        )
        raise InputError(*place, value="", expected=expected)


def _evenly_by_angle(n_dot_v: Float[Tensor, " p"], count: int) -> Int[Tensor, " c"]:
    """Indices of at most `count` pixels, taken in turn from bins of equal width in n·v."""
    angle_bin = (n_dot_v * ANGLE_BINS).long().clamp(0, ANGLE_BINS - 1)
    order = torch.argsort(angle_bin, stable=True)
    in_bin = torch.bincount(angle_bin, minlength=ANGLE_BINS)
    first = in_bin.cumsum(0) - in_bin
    turn = torch.arange(len(order)) - first[angle_bin[order]]
    return order[torch.argsort(turn, stable=True)][:count]
