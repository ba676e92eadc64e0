"""What the photographs say of a texture: for each pixel where it looks, how it is lit, and what it mirrors besides.

seen = surface + body · mean of the texture over the pixel,    body = share of the surroundings' light · far + lamps,

and what the object mirrors of itself is added to `surface`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy import sparse
from torch import Tensor

from fitter.parts import FittedPart
from fitter.photographs import Photograph
from fitter.pixel_model import ExactPixels
from fitter.places import LightShare, Sparse
from fitter.received_light import PLACES, ReceivedLight, Reflected, Returned, looked, received_light
from fitter.reflectances import exact_reflectance
from fitter.textured_pixels import surface_and_body
from renderer import gbuffer
from renderer.gbuffer import GBuffer, Tracer
from renderer.visibility import rough_reflections
from shaders.lobe import smith_g1
from shaders.materials import Glossy, Matte

SIDE = 3  # rays along each side of a pixel
MOST_PIXELS = 1_500_000  # of all photographs; of more, blocks of pixels are taken together
LEAST_COSINE = 0.2  # n·v: of pixels that see the surface flatter, three rays a side leave gaps
SAMPLES = 64  # directions of the mirrored light, at most
MIRRORED = 32  # directions in which a pixel looks for the object that it mirrors
AT_ONCE = 1 << 15  # pixels
TENSORS = ("uv", "area", "seen", "surface", "far", "lamps")


Light = LightShare | Reflected | None
"""Diffuse light as it reaches an object: by what it hides, and by what it sends itself; None where it hides none."""


@dataclass(frozen=True)
class Rows:
    """Pixels of one photograph that see the material.

    Attributes:
        uv: where their rays meet the texture, [p, SIDE²], float32.
        area: of the texture that each pixel covers, in units of the whole.
        seen: what the photograph shows.
        surface: light that is mirrored.
        far: light that a white body sends out in the far surroundings, were they unhidden.
        lamps: the same of directional lights.
        mixing: of places at which the share of the far light is known, [p, n]; None where none of it is hidden.
        itself: what of the object the surface mirrors, and how much; None where that is left out.
    """

    uv: Float[Tensor, "p k 2"]
    area: Float[Tensor, " p"]
    seen: Float[Tensor, "p 3"]
    surface: Float[Tensor, "p 3"]
    far: Float[Tensor, "p 3"]
    lamps: Float[Tensor, "p 3"]
    mixing: Sparse | None = None
    itself: Returned | None = None

    def mirrored(self, light: Light) -> Float[np.ndarray, "p 3"]:
        """Light that is mirrored."""
        surface = self.surface.numpy()
        return surface + light.arriving(self.itself) if self.itself and isinstance(light, Reflected) else surface

    def body(self, light: Light) -> Float[np.ndarray, "p 3"]:
        """Light that a white body sends out."""
        far, lamps = self.far.numpy(), self.lamps.numpy()
        if light is None or self.mixing is None:
            return far + lamps
        share = light.share if isinstance(light, Reflected) else light
        return far * (self.mixing @ share.share) + lamps


def rows(
    part: FittedPart,
    photographs: Sequence[Photograph],
    trace: Tracer,
    left_out: Sequence[int],
    received: ReceivedLight | None,
    progress: Callable[[float], None],
) -> list[Rows]:
    """The rows of every photograph but those `left_out`."""
    looked_at = [index for index in range(len(photographs)) if index not in left_out]
    width = _block_width(photographs, looked_at)
    found = []
    for done, index in enumerate(looked_at):
        progress(done / len(looked_at))
        found.append(_rows(part, photographs[index], trace, width, received))
    return found


def _block_width(photographs: Sequence[Photograph], looked_at: Sequence[int]) -> int:
    """Pixels along the side of the blocks that are taken together, by the first photograph."""
    pixels = int(photographs[looked_at[0]].mask.sum()) * len(looked_at)
    return max(1, math.ceil(math.sqrt(pixels / MOST_PIXELS)))


def light_on(
    part: FittedPart,
    photographs: Sequence[Photograph],
    trace: Tracer,
    left_out: Sequence[int],
    returning: bool,
    seed: int,
) -> ReceivedLight | None:
    """The diffuse light on an object that hides some of it; None where a map says what it hides, or it hides none.

    Args:
        part, photographs, trace, left_out: as of `rows`.
        returning: whether light is counted that the object sends to itself.
        seed: of the choice of places.
    """
    setting = part.setting
    mapped = part.index < len(setting.openness) and setting.openness[part.index] is not None
    if setting.occluder is None or "ambient-occlusion" not in setting.effects or mapped:
        return None
    looked_at = [index for index in range(len(photographs)) if index not in left_out]
    generator, places = torch.Generator().manual_seed(seed), []
    for index in looked_at:
        row, column = photographs[index].mask.nonzero().T
        chosen = torch.randperm(len(row), generator=generator)[: -(-PLACES // len(looked_at))]
        centres = gbuffer.pixel_footprints(trace, photographs[index].camera, column[chosen], row[chosen], 1)[:, 0]
        places.append(centres[centres.front & (centres.material == part.index)])
    return received_light(setting, gbuffer.concatenate(places), trace, returning, seed)


def _rows(part: FittedPart, photograph: Photograph, trace: Tracer, width: int, received: ReceivedLight | None) -> Rows:
    radiance, mask = _blocks(photograph, width)
    parts = []
    for row, column in _some(mask):
        surface = gbuffer.pixel_footprints(trace, photograph.camera, column, row, SIDE, width)
        usable = (surface.front & (surface.material == part.index) & (surface.n_dot_v > LEAST_COSINE)).all(-1)
        if usable.any():
            seen = radiance[row[usable], column[usable]].double()
            parts.append(_lit(part, surface[usable], seen, received, trace))
    if not parts:
        none = torch.zeros(0, 3, dtype=torch.float64)
        return Rows(torch.zeros(0, SIDE**2, 2), torch.zeros(0), none, none, none, none)
    uv, area, seen, surface, far, lamps = (torch.cat([getattr(each, key) for each in parts]) for key in TENSORS)
    mixing = None if received is None else sparse.vstack([each.mixing for each in parts], "csr")
    return Rows(uv, area, seen, surface, far, lamps, mixing, _joined([each.itself for each in parts]))


def _joined(parts: Sequence[Returned | None]) -> Returned | None:
    """Of pixels in turn."""
    found = [each for each in parts if each is not None]
    if not found:
        return None
    met = gbuffer.concatenate([each.met for each in found])
    gathering = sparse.block_diag([each.gathering for each in found], "csr")
    return Returned(met, gathering, sparse.vstack([each.spreading for each in found], "csr"))


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


def _lit(
    part: FittedPart, surface: GBuffer, seen: Float[Tensor, "p 3"], received: ReceivedLight | None, trace: Tracer
) -> Rows:
    material, setting = part.choice.fit.material, part.setting
    assert isinstance(material, Glossy | Matte)
    known = {"ambient-occlusion"} if received is not None else set()
    unhidden = setting.simulating(setting.effects - known)
    model = unhidden.pixels(surface, body=True, shown=True)
    assert isinstance(model, ExactPixels)
    table = unhidden.table_of(material, surface, min(setting.fidelity.samples, SAMPLES))
    mirrored, body = surface_and_body(model.under(table), material)
    lamps = _of_lamps(model.under(table), material)
    centre = surface[:, SIDE**2 // 2]
    mixing = None if received is None else received.places.mixing(centre)
    itself = None
    if received is not None and received.returned is not None and "self-visibility" in setting.effects:
        itself = _itself(part, centre, received, trace)
    return Rows(surface.uv.float(), _texture_area(surface), seen, mirrored, body - lamps, lamps, mixing, itself)


def _itself(part: FittedPart, surface: GBuffer, received: ReceivedLight, trace: Tracer) -> Returned | None:
    """What of the object points [p] mirror, weighted by how much of it: F(v·h) G1(l) of visible normals h."""
    material, occluder = part.choice.fit.material, part.setting.occluder
    if not isinstance(material, Glossy):
        return None
    assert occluder is not None
    u1, u2 = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(MIRRORED).double().T
    u1, u2 = (each.expand(len(surface.hit), -1) for each in (u1, u2))
    towards = rough_reflections(surface, u1, u2, float(material.roughness))
    half = torch.nn.functional.normalize(towards + surface.view[:, None], dim=-1)
    cos_d = (half * towards).sum(-1, keepdim=True).clamp(0, 1)
    cos_l = (surface.normal[:, None] * towards).sum(-1)
    unmasked = smith_g1(cos_l, material.roughness, part.setting.fidelity.distribution)
    mirrored = exact_reflectance(material, cos_d)[..., 0] * unmasked
    met, mean = looked(surface, towards, occluder, trace, mirrored)
    return Returned(met, mean, received.places.mixing(met))


def _of_lamps(model: ExactPixels, material: Glossy | Matte) -> Float[Tensor, "p 3"]:
    """What a white body sends out of the directional lights alone."""
    assert model.body is not None
    if not model.sources:
        return torch.zeros_like(model.body.light[:, 0])
    return surface_and_body(replace(model, body=replace(model.body, light=0 * model.body.light)), material)[1]


def _texture_area(surface: GBuffer) -> Float[Tensor, " p"]:
    """|∂uv/∂x × ∂uv/∂y| of each pixel, from its outermost rays; too large where a seam crosses it."""
    uv = surface.uv.reshape(-1, SIDE, SIDE, 2)
    nodes = gbuffer.equal_weight_nodes(SIDE)
    between = nodes[-1] - nodes[0]
    right = (uv[:, SIDE // 2, -1] - uv[:, SIDE // 2, 0]) / between
    down = (uv[:, -1, SIDE // 2] - uv[:, 0, SIDE // 2]) / between
    return (right[:, 0] * down[:, 1] - right[:, 1] * down[:, 0]).abs()
