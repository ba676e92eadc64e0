"""The surroundings that are seen behind the object, against the environment map: exposure and white balance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitter.loading import Loaded
from fitter.nuisances import Nuisances, unknowns_of
from renderer import latlong
from renderer.camera import Camera
from renderer.exposures import Exposed, expose
from renderer.gbuffer import Tracer
from renderer.latlong import LatLong
from renderer.scene import PhotographSpec, camera_of

LOOKED_AT = 20000  # pixels of a photograph, about
MARGIN = 3  # pixels from the silhouette, or `NEAR` of the photograph's width: what is nearer may be the object
NEAR = 0.01
TILES = 16  # along the longer side: neighbours err together, as a map's texels and its far trees do
SMALLEST_TILE, TILE_PIXELS, FEWEST_TILES = 6, 20, 6  # pixels along a side, pixels looked at, tiles with as many
POSITIVE = 0.9  # share of pixels that hold light; of a cut-out's none does
ALIKE = 0.3  # of the scatter of the map's own tiles that may be left where a photograph is divided by it …
EVEN = 0.1  # … or this much of a logarithm, where the map is even
NOT_OUTLIERS = 0.75  # share of tiles whose scatter counts: half of them may see nothing but the same lawn
SHARE_TO_SIGMA = 1 / 1.1503  # of a normal distribution: 1/Φ⁻¹(⅞)
LEAST_ERROR = 0.005  # of a logarithm: maps and lenses' corners are not better known


@dataclass(frozen=True)
class Behind:
    """What the surroundings behind the object tell of one photograph.

    Attributes:
        ratio: logarithm of photograph over environment, per channel.
        error: its standard deviation.
    """

    ratio: Float[Tensor, "3"]
    error: Float[Tensor, "3"]


def nuisances_of(loaded: Loaded, trace: Tracer) -> Nuisances | None:
    """What the scene file asks to be fitted beside the material, with what is seen behind the object of it.

    None where nothing is asked for; then no photograph is looked at.
    """
    unknowns = unknowns_of(loaded.scene)
    if not unknowns:
        return None
    specs, light = loaded.scene.photographs, latlong.of(loaded.environment)
    ratio, error = torch.zeros(len(specs), 3).double(), torch.full((len(specs), 3), math.inf).double()
    for index, spec in enumerate(specs):
        found = None if index in loaded.repeated else seen_behind(spec, trace, light)
        if found is not None:
            ratio[index], error[index] = found.ratio, found.error
    return Nuisances.before(unknowns, len(specs)).learning(ratio, error)


def seen_behind(spec: PhotographSpec, trace: Tracer, light: LatLong) -> Behind | None:
    """What the surroundings tell of a photograph; None where none are seen, or others than the map's.

    The median over tiles of the median of log pixel/radiance in each: outliers, such as a stand, count by their number
    alone. A picture that is cut out, or whose background varies otherwise than the map, tells nothing.
    """
    seen = expose(spec)
    height, width = seen.clipped.shape
    camera = camera_of(spec.camera, width, height)
    pixels = _pixels(seen)
    pixels = pixels[_clear(pixels, camera, trace)]
    shown = seen.radiance[pixels[:, 0], pixels[:, 1]].double()
    if len(pixels) < TILE_PIXELS or float((shown > 0).all(-1).double().mean()) < POSITIVE:
        return None
    expected = _radiance(pixels, camera, light)
    lit = (shown > 0).all(-1) & (expected > 0).all(-1)
    logs = torch.stack([shown[lit].log() - expected[lit].log(), expected[lit].log()], 1)
    side = max(-(-max(height, width) // TILES), SMALLEST_TILE * _step(seen.clipped.shape))
    tiles = _tile_medians(logs, (pixels[lit] // side) @ torch.tensor([TILES + 1, 1]))
    if len(tiles) < FEWEST_TILES:
        return None
    middle = tiles.median(0).values
    left, own = SHARE_TO_SIGMA * (tiles - middle).abs().quantile(NOT_OUTLIERS, 0)
    if (left > torch.maximum(ALIKE * own, torch.tensor(EVEN).to(own))).any():
        return None
    return Behind(middle[0], (math.sqrt(math.pi / 2 / len(tiles)) * left).clamp_min(LEAST_ERROR))


def _step(size: Sequence[int]) -> int:
    """Distance between the pixels that are looked at."""
    return max(1, round(math.sqrt(math.prod(size) / LOOKED_AT)))


def _pixels(seen: Exposed) -> Int[Tensor, "p 2"]:
    """Rows and columns of pixels that may show surroundings, evenly spread."""
    usable = seen.finite & ~seen.clipped
    step = _step(usable.shape)
    return usable[::step, ::step].nonzero() * step


def _clear(pixels: Int[Tensor, "p 2"], camera: Camera, trace: Tracer) -> Bool[Tensor, " p"]:
    """Those that are well off the object's silhouette."""
    margin = max(MARGIN, NEAR * camera.width)
    clear = torch.ones(len(pixels), dtype=torch.bool)
    for down, right in ((0, 0), (-margin, -margin), (-margin, margin), (margin, -margin), (margin, margin)):
        y, x = (pixels + 0.5).double().T
        rays = camera.rays((x + right).clamp(0, camera.width), (y + down).clamp(0, camera.height))
        clear &= ~trace(*rays).hit
    return clear


def _radiance(pixels: Int[Tensor, "p 2"], camera: Camera, light: LatLong) -> Float[Tensor, "p 3"]:
    """The environment's in each pixel, a mean over 3 × 3 rays."""
    offsets = torch.tensor([1 / 6, 1 / 2, 5 / 6], dtype=torch.float64)
    y, x = (pixels.double()[:, axis, None, None] for axis in (0, 1))
    _, directions = camera.rays(x + offsets[:, None] + 0 * offsets, y + 0 * offsets[:, None] + offsets)
    return latlong.lookup(light, *directions.unbind(-1)).double().mean((1, 2))


def _tile_medians(values: Float[Tensor, "p 2 3"], tile: Int[Tensor, " p"]) -> Float[Tensor, "t 2 3"]:
    """Of each tile with enough pixels."""
    names, counts = tile.unique(return_counts=True)
    medians = [values[tile == name].median(0).values for name in names[counts >= TILE_PIXELS]]
    return torch.stack(medians) if medians else values.new_zeros(0, 2, 3)
