"""What the photographs say of a texture: for each pixel where it looks, how it is lit, and what it mirrors besides.

seen = surface + body · mean of the texture over the pixel
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitter.occluded_body import PLACES, OccludedBody
from fitter.parts import FittedPart
from fitter.photographs import Photograph
from fitter.pixel_model import ExactPixels
from fitter.setting import Setting
from fitter.textured_pixels import surface_and_body
from renderer import gbuffer
from renderer.environment import Environment
from renderer.gbuffer import GBuffer, Tracer
from shaders.materials import Glossy, Matte

SIDE = 3  # rays along each side of a pixel
MOST_PIXELS = 1_500_000  # of all photographs; of more, blocks of pixels are taken together
LEAST_COSINE = 0.2  # n·v: of pixels that see the surface flatter, three rays a side leave gaps
SAMPLES = 64  # directions of the mirrored light, at most
AT_ONCE = 1 << 15  # pixels


@dataclass(frozen=True)
class Rows:
    """Pixels of one photograph that see the material.

    Attributes:
        uv: where their rays meet the texture, [p, SIDE²], float32.
        area: of the texture that each pixel covers, in units of the whole.
        seen: what the photograph shows.
        surface: light that is mirrored.
        body: light that a white body sends out.
    """

    uv: Float[Tensor, "p k 2"]
    area: Float[Tensor, " p"]
    seen: Float[Tensor, "p 3"]
    surface: Float[Tensor, "p 3"]
    body: Float[Tensor, "p 3"]


def rows(
    part: FittedPart,
    photographs: Sequence[Photograph],
    trace: Tracer,
    left_out: Sequence[int],
    seed: int,
    progress: Callable[[float], None],
) -> list[Rows]:
    """The rows of every photograph, `left_out` ones empty."""
    looked_at = [index for index in range(len(photographs)) if index not in left_out]
    width = _block_width(photographs, looked_at)
    occluded = _occluded(part, photographs, trace, looked_at, seed)
    found = []
    for done, index in enumerate(looked_at):
        progress(done / len(looked_at))
        found.append(_rows(part, photographs[index], trace, width, occluded))
    return found


def _block_width(photographs: Sequence[Photograph], looked_at: Sequence[int]) -> int:
    """Pixels along the side of the blocks that are taken together, by the first photograph."""
    pixels = int(photographs[looked_at[0]].mask.sum()) * len(looked_at)
    return max(1, math.ceil(math.sqrt(pixels / MOST_PIXELS)))


def _occluded(
    part: FittedPart, photographs: Sequence[Photograph], trace: Tracer, looked_at: Sequence[int], seed: int
) -> OccludedBody | None:
    setting = part.setting
    mapped = part.index < len(setting.openness) and setting.openness[part.index] is not None
    if setting.occluder is None or "ambient-occlusion" not in setting.effects or mapped:
        return None
    generator, places = torch.Generator().manual_seed(seed), []
    for index in looked_at:
        row, column = photographs[index].mask.nonzero().T
        chosen = torch.randperm(len(row), generator=generator)[: -(-PLACES // len(looked_at))]
        centres = gbuffer.pixel_footprints(trace, photographs[index].camera, column[chosen], row[chosen], 1)[:, 0]
        places.append(centres[centres.front & (centres.material == part.index)])
    return OccludedBody.of(gbuffer.concatenate(places), setting.occluder, _near(setting))


def _near(setting: Setting) -> Environment:
    return replace(setting.environment, radiance=setting.environment.radiance.cpu())


def _rows(part: FittedPart, photograph: Photograph, trace: Tracer, width: int, occluded: OccludedBody | None) -> Rows:
    radiance, mask = _blocks(photograph, width)
    parts = []
    for row, column in _some(mask):
        surface = gbuffer.pixel_footprints(trace, photograph.camera, column, row, SIDE, width)
        usable = (surface.front & (surface.material == part.index) & (surface.n_dot_v > LEAST_COSINE)).all(-1)
        if usable.any():
            parts.append(_lit(part, surface[usable], radiance[row[usable], column[usable]].double(), occluded))
    if not parts:
        none = torch.zeros(0, 3, dtype=torch.float64)
        return Rows(torch.zeros(0, SIDE**2, 2), torch.zeros(0), none, none, none)
    return Rows(*(torch.cat([getattr(each, key) for each in parts]) for key in Rows.__dataclass_fields__))


def _blocks(photograph: Photograph, width: int) -> tuple[Float[Tensor, "h w 3"], Bool[Tensor, "h w"]]:
    """Means over square blocks, and which of them consist of usable pixels only."""
    if width == 1:
        return photograph.radiance, photograph.mask
    height, across = (side // width for side in photograph.mask.shape)

    def pooled(picture: Float[Tensor, "h w c"]) -> Float[Tensor, "i j c"]:
        cut = picture[: height * width, : across * width]
        return cut.reshape(height, width, across, width, -1).mean((1, 3))

    return pooled(photograph.radiance), pooled(photograph.mask[..., None].double())[..., 0] == 1


def _some(mask: Bool[Tensor, "h w"]) -> Iterator[tuple[Tensor, Tensor]]:
    """Rows and columns of a mask's pixels, some at a time."""
    for part in mask.nonzero().split(AT_ONCE):
        if len(part):
            yield part[:, 0], part[:, 1]


def _lit(part: FittedPart, surface: GBuffer, seen: Float[Tensor, "p 3"], occluded: OccludedBody | None) -> Rows:
    material, setting = part.choice.fit.material, part.setting
    assert isinstance(material, Glossy | Matte)
    known = {"ambient-occlusion"} if occluded is not None else set()
    unhidden = setting.simulating(setting.effects - known)
    model = unhidden.pixels(surface, body=True, shown=True)
    assert isinstance(model, ExactPixels)
    if occluded is not None:
        assert model.body is not None
        share = occluded.at(surface[:, SIDE**2 // 2])
        model = replace(model, body=replace(model.body, light=model.body.light * share[:, None]))
    table = unhidden.table_of(material, surface, min(setting.fidelity.samples, SAMPLES))
    mirrored, body = surface_and_body(model.under(table), material)
    return Rows(surface.uv.float(), _texture_area(surface), seen, mirrored, body)


def _texture_area(surface: GBuffer) -> Float[Tensor, " p"]:
    """|∂uv/∂x × ∂uv/∂y| of each pixel, from its outermost rays; too large where a seam crosses it."""
    uv = surface.uv.reshape(-1, SIDE, SIDE, 2)
    nodes = gbuffer.equal_weight_nodes(SIDE)
    between = nodes[-1] - nodes[0]
    right = (uv[:, SIDE // 2, -1] - uv[:, SIDE // 2, 0]) / between
    down = (uv[:, -1, SIDE // 2] - uv[:, 0, SIDE // 2]) / between
    return (right[:, 0] * down[:, 1] - right[:, 1] * down[:, 0]).abs()
