"""The surroundings that are seen behind the object, against the environment map: exposure and white balance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fit_material.fitter.least_squares.nuisances import Nuisances, unknowns_of
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.latlong import LatLong
from fit_material.renderer.photographs.exposure import Exposed, expose
from fit_material.renderer.rays.gbuffer import Tracer
from fit_material.renderer.scene.scene_file import PhotographSpec, camera_of

LOOKED_AT = 20000  # pixels of a photograph, about
MARGIN = 3  # pixels from the silhouette, or `NEAR` of the photograph's width: nearer pixels may be the object's
NEAR = 0.01
TILES = 16  # along the longer side: neighbours err together, as a map's texels and its far trees do
SMALLEST_TILE, TILE_PIXELS, FEWEST_TILES = 6, 20, 6  # pixels along a side, pixels looked at, tiles with as many
POSITIVE = 0.9  # share of pixels that hold light; of a cut-out's none does
ALIKE = 0.3  # of the scatter of the map's own tiles that may be left where a photograph is divided by it …
EVEN = 0.1  # … or this much of a logarithm, where the map is even
NOT_OUTLIERS = 0.75  # share of tiles whose scatter counts: half of them may see nothing but the same lawn
SHARE_TO_SIGMA = 1 / 1.1503  # of a normal distribution: 1/Φ⁻¹(⅞)
TRIED_TURNS = tuple(each / 2 for each in range(-12, 13))  # degrees
UNTOLD = 1.0  # scatter in the place of that of surroundings unlike the map's
LEAST_ERROR = 0.005  # of a logarithm: maps and lenses' corners are not better known


@dataclass(frozen=True)
class Behind:
    """Calibration of one photograph by the surroundings behind the object.

    Attributes:
        ratio: logarithm of photograph over environment, per channel.
        error: its standard deviation.
        scatter: of that logarithm over tiles.
    """

    ratio: Float[Tensor, "3"]
    error: Float[Tensor, "3"]
    scatter: Float[Tensor, "3"]


def nuisances_of(loaded: Loaded, trace: Tracer) -> Nuisances | None:
    """Nuisance parameters of the scene file, with their calibration by the background.

    None where there are none; then no photograph is read. Where the environment's rotation is unknown, too,
    the map is rotated to where it is most like the background, to half a degree.
    """
    unknowns = unknowns_of(loaded.scene)
    if not unknowns:
        return None
    specs, environment = loaded.scene.photographs, loaded.environment
    patches = [None if i in loaded.repeated else Patch.of(spec, trace) for i, spec in enumerate(specs)]
    before = Nuisances.before(unknowns, len(specs))
    tried = []
    for degrees in (0.0,) if before.turn is None else TRIED_TURNS:
        light = latlong.of(replace(environment, rotation=environment.rotation + degrees))
        tried.append([None if patch is None else patch.against(light) for patch in patches])
    found = min(tried, key=lambda told: sum(UNTOLD if each is None else float(each.scatter.mean()) for each in told))
    ratio, error = torch.zeros(len(specs), 3).double(), torch.full((len(specs), 3), math.inf).double()
    for index, each in enumerate(found):
        if each is not None:
            ratio[index], error[index] = each.ratio, each.error
    return before.learning(ratio, error)


@dataclass(frozen=True)
class Patch:
    """Pixels of a photograph beside the object.

    Attributes:
        shown: what they show.
        directions: of 3 × 3 rays in each.
        tile: a number for each, the same within a tile.
    """

    shown: Float[Tensor, "p 3"]
    directions: Float[Tensor, "p 3 3 3"]
    tile: Int[Tensor, " p"]

    @staticmethod
    def of(spec: PhotographSpec, trace: Tracer) -> Patch | None:
        """None where nothing is lit beside the object, as in a picture that is cut out."""
        seen = expose(spec)
        height, width = seen.clipped.shape
        camera = camera_of(spec.camera, width, height)
        pixels = _pixels(seen)
        pixels = pixels[_clear(pixels, camera, trace)]
        shown = seen.radiance[pixels[:, 0], pixels[:, 1]].double()
        if len(pixels) < TILE_PIXELS or float((shown > 0).all(-1).double().mean()) < POSITIVE:
            return None
        side = max(-(-max(height, width) // TILES), SMALLEST_TILE * _step(seen.clipped.shape))
        return Patch(shown, _directions(pixels, camera), (pixels // side) @ torch.tensor([TILES + 1, 1]))

    def against(self, light: LatLong) -> Behind | None:
        """Over what the environment has there; None where the background varies otherwise than the map.

        The median over tiles of the median of log pixel/radiance in each: outliers, such as a stand, count by their
        number alone.
        """
        expected = latlong.lookup(light, *self.directions.unbind(-1)).double().mean((1, 2))
        lit = (self.shown > 0).all(-1) & (expected > 0).all(-1)
        logs = torch.stack([self.shown[lit].log() - expected[lit].log(), expected[lit].log()], 1)
        tiles = _tile_medians(logs, self.tile[lit])
        if len(tiles) < FEWEST_TILES:
            return None
        middle = tiles.median(0).values
        left, own = SHARE_TO_SIGMA * (tiles - middle).abs().quantile(NOT_OUTLIERS, 0)
        if (left > torch.maximum(ALIKE * own, torch.tensor(EVEN).to(own))).any():
            return None
        return Behind(middle[0], (math.sqrt(math.pi / 2 / len(tiles)) * left).clamp_min(LEAST_ERROR), left)


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


def _directions(pixels: Int[Tensor, "p 2"], camera: Camera) -> Float[Tensor, "p 3 3 3"]:
    """Of 3 × 3 rays in each pixel."""
    offsets = torch.tensor([1 / 6, 1 / 2, 5 / 6], dtype=torch.float64)
    y, x = (pixels.double()[:, axis, None, None] for axis in (0, 1))
    return camera.rays(x + offsets[:, None] + 0 * offsets, y + 0 * offsets[:, None] + offsets)[1]


def _tile_medians(values: Float[Tensor, "p 2 3"], tile: Int[Tensor, " p"]) -> Float[Tensor, "t 2 3"]:
    """Of each tile with enough pixels."""
    names, counts = tile.unique(return_counts=True)
    medians = [values[tile == name].median(0).values for name in names[counts >= TILE_PIXELS]]
    return torch.stack(medians) if medians else values.new_zeros(0, 2, 3)
