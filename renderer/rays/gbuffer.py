"""Per-pixel geometry: what each camera ray meets, and how the surface lies there."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Real
from torch import Tensor

from fit_material.renderer.cameras.camera import Camera
from fit_material.renderer.geometry.mesh import Mesh, Shape, Sphere
from fit_material.renderer.geometry.tangents import tangents
from fit_material.renderer.mitsuba import raycast

RAYS = 1 << 20  # traced at a time


@dataclass(frozen=True)
class GBuffer:
    """The surface seen along each of a set of rays; any leading shape. Values off the object are zero.

    Attributes:
        hit: whether the ray meets the object.
        position: world space.
        normal: unit shading normal, interpolated where the mesh has vertex normals.
        geometric_normal: unit normal of the surface itself.
        uv: texture coordinates.
        view: unit direction back along the ray, to the camera.
        material: index into the mesh's material names.
        part: index into the mesh's objects.
        tangent: as `tangents` has it at vertices, interpolated; 0 where there is none.
    """

    hit: Bool[Tensor, "*p"]
    position: Float[Tensor, "*p 3"]
    normal: Float[Tensor, "*p 3"]
    geometric_normal: Float[Tensor, "*p 3"]
    uv: Float[Tensor, "*p 2"]
    view: Float[Tensor, "*p 3"]
    material: Int[Tensor, "*p"]
    part: Int[Tensor, "*p"]
    tangent: Float[Tensor, "*p 4"]

    @property
    def n_dot_v(self) -> Float[Tensor, "*p"]:
        """Cosine between the shading normal and the view direction; 0 off the object."""
        return (self.normal * self.view).sum(-1)

    @property
    def front(self) -> Bool[Tensor, "*p"]:
        """Whether the ray meets the outer side, by the shading normal and by the geometric one."""
        return self.hit & (self.n_dot_v > 0) & ((self.geometric_normal * self.view).sum(-1) > 0)

    def __getitem__(self, index: object) -> GBuffer:
        return GBuffer(*(getattr(self, f.name)[index] for f in fields(self)))

    def reshape(self, *shape: int) -> GBuffer:
        """The same rays under another leading shape."""
        lead = self.hit.dim()
        return GBuffer(*((t := getattr(self, f.name)).reshape(*shape, *t.shape[lead:]) for f in fields(self)))

    def to(self, device: torch.device) -> GBuffer:
        """The same rays on another device."""
        return GBuffer(*(getattr(self, f.name).to(device) for f in fields(self)))


Tracer = Callable[[Float[Tensor, "p 3"], Float[Tensor, "p 3"]], GBuffer]


def concatenate(buffers: list[GBuffer]) -> GBuffer:
    """Several G-buffers, one after another along the first axis."""
    return GBuffer(*(torch.cat([getattr(b, f.name) for b in buffers]) for f in fields(GBuffer)))


def where(chosen: Bool[Tensor, "*p"], one: GBuffer, other: GBuffer) -> GBuffer:
    """Of two G-buffers of one shape the first one's rays where chosen, by leading axes, and the other's elsewhere."""

    def either(name: str) -> Tensor:
        first, second = getattr(one, name), getattr(other, name)
        return torch.where(chosen.reshape(*chosen.shape, *[1] * (first.dim() - chosen.dim())), first, second)

    return GBuffer(*(either(f.name) for f in fields(GBuffer)))


def tracer(shape: Shape) -> Tracer:
    """A function from rays (origins, unit directions, float64 [p, 3]) to the G-buffer of their nearest hits."""
    return _in_blocks(_trace_sphere if isinstance(shape, Sphere) else _mesh_tracer(shape))


def _in_blocks(trace: Tracer) -> Tracer:
    """The same for any number of rays, in memory for `RAYS` of them beside their G-buffer."""

    def traced(origins: Float[Tensor, "p 3"], directions: Float[Tensor, "p 3"]) -> GBuffer:
        if len(origins) <= RAYS:
            return trace(origins, directions)
        blocks = zip(origins.split(RAYS), directions.split(RAYS), strict=True)
        return concatenate([trace(*block) for block in blocks])

    return traced


def pixel_centres(trace: Tracer, camera: Camera) -> GBuffer:
    """The G-buffer [height, width] of rays through the pixels' centres."""
    row, column = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    origins, directions = camera.rays(column.flatten() + 0.5, row.flatten() + 0.5)
    return trace(origins, directions).reshape(camera.height, camera.width)


def pixel_footprints(
    trace: Tracer, camera: Camera, column: Real[Tensor, " p"], row: Real[Tensor, " p"], side: int, width: int = 1
) -> GBuffer:
    """The G-buffer [p, side²] of a grid of rays inside each given pixel.

    A photograph's pixel is a mean over its area; near the silhouette it sees many angles at once. The rays count
    alike, and their mean is exact for polynomials of degree `side` or `side` + 1 in the place within the pixel: a plain
    grid is too narrow, which a fit would take for a rougher surface.

    Args:
        trace: of the object.
        camera: the photograph's.
        column, row: upper left corner of each pixel, in units of `width`; need not be whole.
        side: rays along each side.
        width: of the pixels, in the camera's own; more than 1 for blocks of them.
    """
    x, y = (width * (each.double() + 0.5) for each in (column, row))
    return film_footprints(trace, camera, x, y, width, width, side)


def film_footprints(
    trace: Tracer,
    camera: Camera,
    x: Float[Tensor, " p"],
    y: Float[Tensor, " p"],
    across: Float[Tensor, " p"] | float,
    down: Float[Tensor, " p"] | float,
    side: int,
) -> GBuffer:
    """The G-buffer [p, side²] of such a grid of rays inside rectangles of the film.

    Args:
        trace: of the object.
        camera: whose film.
        x, y: middle of each rectangle, in pixels.
        across, down: its sides.
        side: rays along each.
    """
    offset = torch.tensor(equal_weight_nodes(side), dtype=torch.float64) - 0.5
    dy, dx = (grid.flatten() for grid in torch.meshgrid(offset, offset, indexing="ij"))
    across, down = (torch.as_tensor(each, dtype=torch.float64).expand(len(x))[:, None] for each in (across, down))
    origins, directions = camera.rays((x[:, None] + across * dx).flatten(), (y[:, None] + down * dy).flatten())
    return trace(origins, directions).reshape(len(x), side**2)


# Halves of Chebyshev's equal-weight nodes on [-1, 1] [Abramowitz & Stegun 1964, table 25.5]
_CHEBYSHEV = {
    1: (),
    2: (0.5773502691896258,),
    3: (0.7071067811865476,),
    4: (0.1875924740850799, 0.7946544722917661),
    5: (0.3745414095535811, 0.8324974870009819),
    6: (0.2666354015167047, 0.4225186537611115, 0.8662468181078206),
    7: (0.3239118105199076, 0.5296567752851569, 0.8838617007580490),
}


def equal_weight_nodes(count: int) -> list[float]:
    """Places in [0, 1] whose plain mean integrates; beyond seven a midpoint grid, widened to the variance of 1/12."""
    if count in _CHEBYSHEV:
        right = [0.5 + node / 2 for node in _CHEBYSHEV[count]]
        return [1 - place for place in reversed(right)] + [0.5] * (count % 2) + right
    widened = (1 - count**-2) ** -0.5
    return [0.5 + widened * ((i + 0.5) / count - 0.5) for i in range(count)]


def _trace_sphere(origins: Float[Tensor, "p 3"], directions: Float[Tensor, "p 3"]) -> GBuffer:
    along = (origins * directions).sum(-1, keepdim=True)
    nearest = origins - along * directions
    inside = 1 - (nearest**2).sum(-1, keepdim=True)  # keeps its digits from far away, unlike b² - 4ac
    half_chord = inside.clamp_min(0).sqrt()
    distance = torch.where(-along - half_chord > 0, -along - half_chord, -along + half_chord)
    hit = ((inside > 0) & (distance > 0))[:, 0]
    normal = torch.nn.functional.normalize(nearest + (distance + along) * directions, dim=-1)
    normal = torch.where(hit[:, None], normal, 0.0)
    azimuth = torch.atan2(normal[:, 1], normal[:, 0]) / (2 * math.pi)
    uv = torch.stack([azimuth - azimuth.floor(), torch.acos(normal[:, 2].clamp(-1, 1)) / math.pi], -1)
    uv = torch.where(hit[:, None], uv, 0.0)
    first = torch.zeros(len(hit), dtype=torch.long)
    return GBuffer(hit, normal, normal, normal, uv, -directions, first, first, normal.new_zeros(len(hit), 4))


def _mesh_tracer(mesh: Mesh) -> Tracer:
    cast, tangent = raycast.caster(mesh), tangents(mesh)

    def trace(origins: Float[Tensor, "p 3"], directions: Float[Tensor, "p 3"]) -> GBuffer:
        face = cast(origins, directions)
        hit = face >= 0
        met = _interpolate(mesh, tangent, face[hit], origins.numpy()[hit], directions.numpy()[hit])
        return replace(_spread(met, torch.from_numpy(hit)), view=-directions)

    return trace


def _interpolate(
    mesh: Mesh,
    tangent: Float[np.ndarray, "v 4"] | None,
    face: Int[np.ndarray, " p"],
    origins: Float[np.ndarray, "p 3"],
    directions: Float[np.ndarray, "p 3"],
) -> GBuffer:
    """The surface where each ray meets its face."""
    vertex = mesh.faces[face]
    corner = mesh.vertices[vertex]
    weights = raycast.barycentric(corner, origins, directions)

    def mix(attribute: Float[np.ndarray, "v c"] | None, channels: int) -> Float[Tensor, "p c"]:
        if attribute is None:
            return torch.zeros(len(face), channels, dtype=torch.float64)
        return torch.from_numpy(np.einsum("pi,pic->pc", weights, attribute[vertex]))

    flat = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    geometric = torch.nn.functional.normalize(torch.from_numpy(flat), dim=-1)
    smooth = torch.nn.functional.normalize(mix(mesh.normals, 3), dim=-1)
    return GBuffer(
        hit=torch.ones(len(face), dtype=torch.bool),
        position=mix(mesh.vertices, 3),
        normal=geometric if mesh.normals is None else smooth,
        geometric_normal=geometric,
        uv=mix(mesh.uv, 2),
        view=torch.from_numpy(-directions),
        material=torch.from_numpy(mesh.material[face]),
        part=torch.from_numpy((np.zeros_like(mesh.material) if mesh.part is None else mesh.part)[face]),
        tangent=mix(tangent, 4),
    )


def _spread(met: GBuffer, hit: Bool[Tensor, " p"]) -> GBuffer:
    """The hits' values at the rays that hit, 0 at the others."""

    def spread(values: Tensor) -> Tensor:
        return values.new_zeros(len(hit), *values.shape[1:]).index_put((hit,), values)

    return GBuffer(*(spread(getattr(met, f.name)) for f in fields(met)))
