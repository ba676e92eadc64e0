"""A few pixels of each material, and the surface that each sees: what a coarse fit is made to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.fitter.observations.photograph import Photograph, known_exposure
from fit_material.fitter.observations.pixel_request import PixelRequest
from fit_material.fitter.observations.pixel_selection import Observations, choose_pixels
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer

PIXELS = 420  # over all photographs
FEWEST = 40  # of one photograph
FOOTPRINT = 2  # rays along a pixel's side


@dataclass(frozen=True)
class SampledPixels:
    """Pixels of one material.

    Attributes:
        surface: [p, k] rays inside each.
        seen: radiance, channel by channel, float32.
        photograph: which each is of, counted among those that were looked at.
        exposure: pixel = exposure · radiance.
    """

    surface: GBuffer
    seen: Float[Tensor, "3 p"]
    photograph: Int[Tensor, " p"]
    exposure: Float[Tensor, " p"]


def look(
    photographs: Sequence[Photograph],
    numbers: Sequence[int],
    trace: Tracer,
    scene_file: Path,
    materials: int,
    seed: int,
) -> list[SampledPixels]:
    """Pixels of every material that any of the photographs shows, none of one whose camera misses the object.

    Args:
        photographs: of the scene.
        numbers: of those to look at; they are counted anew.
        trace: of the object.
        scene_file: of the scene.
        materials: how many the object has.
        seed: of the choice of pixels.

    Raises:
        InputError: none of these photographs shows the object's front.
    """
    quota = max(FEWEST, PIXELS // len(numbers))
    found: list[list[tuple[int, Observations]]] = [[] for _ in range(materials)]
    exposures = []
    for index, number in enumerate(numbers):
        photograph = photographs[number]
        exposures.append(known_exposure(photograph.exposure))
        try:
            chosen = choose_pixels(PixelRequest([photograph], trace, scene_file, FOOTPRINT, seed, materials), quota)
        except (
            InputError
        ):  # its camera sees nothing of the object, which the silhouette's check reports, or the mesh's inside
            if index + 1 == len(numbers) and not any(found):
                raise
            continue
        for part, observed in zip(found, chosen, strict=True):
            part += [(index, observed.measured)] if observed is not None else []
    return [_joined(part, torch.tensor(exposures)) for part in found if part]


def _joined(part: Sequence[tuple[int, Observations]], exposures: Float[Tensor, " i"]) -> SampledPixels:
    surface = gbuffer.concatenate([observed.surface for _, observed in part])
    seen = torch.cat([observed.radiance for _, observed in part]).float().T
    index = torch.cat([torch.full((len(observed.radiance),), i) for i, observed in part])
    return SampledPixels(surface, seen, index, exposures[index])
