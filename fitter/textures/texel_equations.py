"""Linear equations of a texture by pixels: where each looks, how it is lit, and what it mirrors besides.

seen = mirrored + body · mean of the texture over the pixel
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

from fit_material.fitter.fitted.part import FittedPart
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.forward.pixel_model import ExactPixels
from fit_material.fitter.forward.received_light import DiffuseLight
from fit_material.fitter.forward.surface_samples import Sparse
from fit_material.fitter.observations.photograph import Photograph
from fit_material.fitter.textures.radiosity import PLACES, Looking, Radiosity, Transfer, radiosity, shifted_points
from fit_material.renderer.light_tables.irradiance_table import even_table
from fit_material.renderer.rays import gbuffer
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer
from fit_material.renderer.rays.occlusion import Occluder
from fit_material.renderer.rays.self_visibility import rough_reflections
from fit_material.shaders.materials.fresnel_models import exact_reflectance
from fit_material.shaders.materials.types import Material
from fit_material.shaders.materials.widths import alpha_of
from fit_material.shaders.optics import microfacets

SIDE = 3  # rays along each side of a pixel
MOST_PIXELS = 1_500_000  # of all photographs; of more, blocks of pixels are taken together
LEAST_COSINE = 0.2  # n·v: of pixels that see the surface flatter, three rays a side leave gaps
SAMPLES = 64  # directions of the mirrored light, at most
MIRRORED = 32  # rays of each pixel in which it looks for the object that it mirrors
MOST_MIRRORED = 1 << 24  # of all pixels
FEWEST_PLACES = 8  # that may stand for a material
AT_ONCE = 1 << 15  # pixels


@dataclass(frozen=True)
class TexelEquations:
    """Pixels of one photograph that see the material.

    Attributes:
        uv: where their rays meet the texture, [p, SIDE²], float32.
        area: of the texture that each pixel covers, in units of the whole.
        seen: what the photograph shows.
        surface: light that is mirrored, but for the object's own.
        far: light that a white body sends out in the far surroundings, if nothing but given maps dims them.
        sources: the same of lights beside the environment.
        even: the same of light of radiance 1 from all sides.
        mixing: of places at which diffuse light is known, [p, n]; None where it is not.
        itself: what of the object the surface mirrors, weighted by how much; None where that is left out.
    """

    uv: Float[Tensor, "p k 2"]
    area: Float[Tensor, " p"]
    seen: Float[Tensor, "p 3"]
    surface: Float[Tensor, "p 3"]
    far: Float[Tensor, "p 3"]
    sources: Float[Tensor, "p 3"]
    even: Float[Tensor, "p 3"]
    mixing: Sparse | None = None
    itself: Transfer | None = None

    @staticmethod
    def none() -> TexelEquations:
        """No pixels."""
        nothing = torch.zeros(0, 3, dtype=torch.float64)
        return TexelEquations(
            uv=torch.zeros(0, SIDE**2, 2),
            area=torch.zeros(0),
            seen=nothing,
            surface=nothing,
            far=nothing,
            sources=nothing,
            even=nothing,
        )

    @staticmethod
    def concatenate(parts: Sequence[TexelEquations]) -> TexelEquations:
        """The pixels of all parts; of none, no pixels."""
        if not parts:
            return TexelEquations.none()
        mixings = [each.mixing for each in parts if each.mixing is not None]
        mirrors = [each.itself for each in parts if each.itself is not None]
        return TexelEquations(
            uv=torch.cat([each.uv for each in parts]),
            area=torch.cat([each.area for each in parts]),
            seen=torch.cat([each.seen for each in parts]),
            surface=torch.cat([each.surface for each in parts]),
            far=torch.cat([each.far for each in parts]),
            sources=torch.cat([each.sources for each in parts]),
            even=torch.cat([each.even for each in parts]),
            mixing=sparse.vstack(mixings, "csr") if mixings else None,
            itself=Transfer.joined(mirrors) if mirrors else None,
        )

    def mirrored(self, light: DiffuseLight | None) -> Float[np.ndarray, "p 3"]:
        """Light that is mirrored, where diffuse light is as it is at places; None for far surroundings alone."""
        surface = self.surface.numpy()
        return surface if light is None or self.itself is None else surface + self.itself.arriving(light)

    def body(self, light: DiffuseLight | None) -> Float[np.ndarray, "p 3"]:
        """Light that a white body sends out."""
        far, sources, even = (each.numpy() for each in (self.far, self.sources, self.even))
        if light is None or self.mixing is None:
            return far + sources
        return far * (self.mixing @ light.share) + sources + even * (self.mixing @ light.returned)


def rows(
    part: FittedPart,
    photographs: Sequence[Photograph],
    trace: Tracer,
    left_out: Sequence[int],
    found: Radiosity | None,
    progress: Callable[[float], None],
) -> list[TexelEquations]:
    """The rows of every photograph but those `left_out`.

    Args:
        part: the material, and its light.
        photographs, trace, left_out: of the scene.
        found: the places whose diffuse light the rows depend on; None where they know it all.
        progress: called with the fraction done.
    """
    looked_at = [index for index in range(len(photographs)) if index not in left_out]
    pixels = int(photographs[looked_at[0]].mask.sum()) * len(looked_at)
    width = max(1, math.ceil(math.sqrt(pixels / MOST_PIXELS)))  # of blocks that are taken together
    rays = min(MIRRORED, max(1, MOST_MIRRORED * width**2 // max(1, pixels)))
    about = _About(part, trace, found, rays)
    every = []
    for done, index in enumerate(looked_at):
        progress(done / len(looked_at))
        every.append(_rows(about, photographs[index], width))
    return every


@dataclass(frozen=True)
class _About:
    """What rows are made by; `rays` are those of each pixel in which it looks for the object that it mirrors."""

    part: FittedPart
    trace: Tracer
    found: Radiosity | None
    rays: int


def radiosity_on(
    part: FittedPart,
    photographs: Sequence[Photograph],
    trace: Tracer,
    left_out: Sequence[int],
    returning: bool,
    seed: int,
) -> Radiosity | None:
    """How the object's places are lit; None where a map gives its occlusion, where nothing occludes or shall, or
    where the material is seen too little.

    Args:
        part, photographs, trace, left_out: as of `rows`.
        returning: whether light is counted that the object sends to itself.
        seed: of the choice of places.
    """
    lighting = part.lighting
    mapped = part.index < len(lighting.openness) and lighting.openness[part.index] is not None
    if lighting.occluder is None or "ambient-occlusion" not in lighting.effects or mapped:
        return None
    looked_at = [index for index in range(len(photographs)) if index not in left_out]
    generator, places = torch.Generator().manual_seed(seed), []
    for index in looked_at:
        row, column = photographs[index].mask.nonzero().T
        chosen = torch.randperm(len(row), generator=generator)[: -(-PLACES // len(looked_at))]
        centres = gbuffer.pixel_footprints(trace, photographs[index].camera, column[chosen], row[chosen], 1)[:, 0]
        places.append(centres[centres.front & (centres.material == part.index)])
    seen = gbuffer.concatenate(places)
    return radiosity(lighting, seen, trace, returning, seed) if len(seen.hit) >= FEWEST_PLACES else None


def _rows(about: _About, photograph: Photograph, width: int) -> TexelEquations:
    radiance, mask = _blocks(photograph, width)
    parts = []
    for row, column in _some(mask):
        surface = gbuffer.pixel_footprints(about.trace, photograph.camera, column, row, SIDE, width)
        own = surface.front & (surface.material == about.part.index) & (surface.n_dot_v > LEAST_COSINE)
        usable = own.all(-1)
        if usable.any():
            parts.append(_lit(about, surface[usable], radiance[row[usable], column[usable]].double()))
    return TexelEquations.concatenate(parts)


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


def _lit(about: _About, surface: GBuffer, seen: Float[Tensor, "p 3"]) -> TexelEquations:
    part, found = about.part, about.found
    material, lighting = part.choice.fit.material, part.lighting
    assert material.color is not None
    known = {"ambient-occlusion"} if found is not None else set()
    unhidden = lighting.simulating(lighting.effects - known)
    model = unhidden.pixels(surface, body=True, shown=True)
    assert isinstance(model, ExactPixels)
    table = unhidden.table_of(material, surface, min(lighting.fidelity.samples, SAMPLES))
    white = material.with_color(torch.ones_like(material.color))
    mirrored = model.under(table).radiance(material.with_color(0 * material.color))
    far, sources, even = (each.sent_by_body(white) for each in _lights(model))
    centre = surface[:, SIDE**2 // 2]
    mixing = None if found is None else found.places.mixing(centre)
    itself, sees = None, "self-visibility" in lighting.effects  # else what it hides is still among the mirrored
    if material.width is not None and sees and found is not None and found.transfer is not None:
        itself = _itself(
            material, lighting, centre, Looking(about.trace, _occluder(lighting), found.places), about.rays
        )
    return TexelEquations(
        uv=surface.uv.float(),
        area=_texture_area(surface),
        seen=seen,
        surface=mirrored,
        far=far,
        sources=sources,
        even=even,
        mixing=mixing,
        itself=itself,
    )


def _lights(model: ExactPixels) -> tuple[ExactPixels, ExactPixels, ExactPixels]:
    """The same bodies in the far surroundings, in the lights beside them, and in light of radiance 1 from all sides."""
    assert model.body is not None
    body, unlit = model.body, 0 * model.body.light
    even = even_table(body.light.shape[1])[:, None].expand_as(body.light)
    return (
        replace(model, sources=()),
        replace(model, body=replace(body, light=unlit)),
        replace(model, body=replace(body, light=even), sources=()),
    )


def _occluder(lighting: Lighting) -> Occluder:
    assert lighting.occluder is not None
    return lighting.occluder


def _itself(material: Material, lighting: Lighting, surface: GBuffer, looking: Looking, rays: int) -> Transfer:
    """What of the object points [p] mirror, each ray weighted by BRDF · n·l over the density that it is drawn by."""
    assert material.width is not None
    alpha, distribution = float(alpha_of(material.width)), lighting.fidelity.distribution
    generator = torch.Generator().manual_seed(lighting.seed)
    towards = rough_reflections(surface, *shifted_points(len(surface.hit), rays, generator), alpha)
    half = torch.nn.functional.normalize(towards + surface.view[:, None], dim=-1)
    cos_h, cos_d = ((half * each[:, None]).sum(-1).clamp(1e-6, 1) for each in (surface.normal, surface.view))
    cos_l, cos_v = (towards * surface.normal[:, None]).sum(-1), surface.n_dot_v[:, None].clamp_min(1e-6)
    drawn = microfacets.visible_normal_density(cos_v, cos_h, alpha)
    mirrored = microfacets.reflected(cos_v, cos_l, cos_h, alpha, distribution) / drawn
    return Transfer.of(surface, towards, exact_reflectance(material, cos_d[..., None])[..., 0] * mirrored, looking)


def _texture_area(surface: GBuffer) -> Float[Tensor, " p"]:
    """|∂uv/∂x × ∂uv/∂y| of each pixel, from its outermost rays; too large where a seam crosses it."""
    uv = surface.uv.reshape(-1, SIDE, SIDE, 2)
    nodes = gbuffer.equal_weight_nodes(SIDE)
    between = nodes[-1] - nodes[0]
    right = (uv[:, SIDE // 2, -1] - uv[:, SIDE // 2, 0]) / between
    down = (uv[:, -1, SIDE // 2] - uv[:, 0, SIDE // 2]) / between
    return (right[:, 0] * down[:, 1] - right[:, 1] * down[:, 0]).abs()
