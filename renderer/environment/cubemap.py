"""Cubemaps: six faces in OpenGL's order and orientation, looked up bilinearly and seamlessly across their edges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.renderer.environment import latlong
from fit_material.renderer.environment.environment import Environment

FACES = ("px", "nx", "py", "ny", "pz", "nz")

AXES = torch.tensor(
    [
        [[0, 0, -1], [0, -1, 0], [1, 0, 0]],
        [[0, 0, 1], [0, -1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
    ],
    dtype=torch.float64,
)
"""Per face: the world axes (right, down, outward) of its picture [OpenGL 4.6 core, table 8.19]."""


@dataclass(frozen=True)
class Cubemap:
    """Six faces, of radiance or of whatever else there is to look up by direction.

    Attributes:
        faces: [6, n, n, c] in the order of `FACES`; rows run downwards in each face's picture.
    """

    faces: Float[Tensor, "6 n n c"]

    @cached_property
    def stacked(self) -> Float[Tensor, "1 c rows columns"]:
        """The faces with their borders, one below the other."""
        bordered = with_margin(self.faces)
        return bordered.flatten(0, 1).permute(2, 0, 1)[None].contiguous()


def face_directions(size: int, margin: int = 0) -> Float[Tensor, "6 m m 3"]:
    """Unit directions of texel centres, float64; with a margin, also of the texels that would lie around each face."""
    centre = (2 * torch.arange(-margin, size + margin, dtype=torch.float64) + 1) / size - 1
    down, right = torch.meshgrid(centre, centre, indexing="ij")
    local = torch.stack([right, down, torch.ones_like(right)], -1)
    return torch.nn.functional.normalize(torch.einsum("rcj,fji->frci", local, AXES), dim=-1)


def face_position(
    directions: Float[Tensor, "*p 3"],
) -> tuple[Int[Tensor, "*p"], Float[Tensor, "*p"], Float[Tensor, "*p"]]:
    """The face that each direction meets, and where on it.

    Returns:
        index into `FACES`, and position to the right and downwards on that face, each in [-1, 1].
    """
    axes = AXES.to(directions)
    outward = directions @ axes[:, 2].T
    face = outward.argmax(-1)
    depth = outward.gather(-1, face[..., None])[..., 0]
    right = (directions * axes[face, 0]).sum(-1) / depth
    down = (directions * axes[face, 1]).sum(-1) / depth
    return face, right, down


def lookup(cubemap: Cubemap, directions: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p c"]:
    """The faces' values in each direction, bilinear within a face and across its edges.

    Args:
        cubemap: the six faces.
        directions: need not be unit length, must not be zero.

    Returns:
        values [*p, c] in the faces' dtype; differentiable with respect to directions and texels.
    """
    size = cubemap.faces.shape[1]
    face, right, down = face_position(directions.to(cubemap.faces))
    # The bordered faces stand below each other, so that one lookup in one picture serves all six.
    column = (right + 1) * size / 2 + 1
    row = (down + 1) * size / 2 + 1 + face * (size + 2)
    grid = torch.stack([column * (2 / (size + 2)) - 1, row * (2 / (6 * (size + 2))) - 1], -1).reshape(1, -1, 1, 2)
    found = torch.nn.functional.grid_sample(cubemap.stacked, grid, mode="bilinear", align_corners=False)
    return found[0, :, :, 0].T.reshape(*directions.shape[:-1], -1)


def smooth_lookup(
    bordered: Float[Tensor, "6 m m c"], margin: int, directions: Float[Tensor, "*p 3"]
) -> Float[Tensor, "*p c"]:
    """The value of a smooth function in each direction, by polynomials of degree five through 6 × 6 texels.

    Bilinear lookups lie within the texels' values: below a curve's crests and above its troughs, everywhere.

    Args:
        bordered: the six faces at `face_directions(size, margin)`.
        margin: at least 3, so that texels lie on all sides of each place.
        directions: need not be unit length, must not be zero.

    Returns:
        values [*p, c] in the faces' dtype.
    """
    width = bordered.shape[1]
    size = width - 2 * margin
    face, *position = face_position(directions.reshape(-1, 3).double())
    (column, by_column), (row, by_row) = (_around((each + 1) * size / 2 - 0.5 + margin) for each in position)
    texel = (face[:, None, None] * width + row[:, :, None]) * width + column[:, None, :]
    weight = (by_row[:, :, None] * by_column[:, None, :]).to(bordered)
    found = torch.nn.functional.embedding_bag(
        texel.flatten(1), bordered.flatten(0, 2), per_sample_weights=weight.flatten(1), mode="sum"
    )
    return found.reshape(*directions.shape[:-1], -1)


def _around(place: Float[Tensor, " p"]) -> tuple[Int[Tensor, "p 6"], Float[Tensor, "p 6"]]:
    """The six whole numbers around each place, and the weights of Lagrange's polynomial through them."""
    first = place.floor() - 2
    steps = torch.arange(6, dtype=place.dtype)
    away = (place - first)[:, None, None] - steps
    apart = steps[:, None] - steps
    own = torch.eye(6, dtype=torch.bool)
    weight = torch.where(own, 1.0, away / torch.where(own, 1.0, apart)).prod(-1)
    return (first[:, None] + steps).long(), weight


def with_margin(faces: Float[Tensor, "6 n n c"]) -> Float[Tensor, "6 n+2 n+2 c"]:
    """Each face with a border of one texel, taken from its neighbours as GL's seamless filtering takes it.

    An edge's border is the row of texels on the other side of the edge; a corner, where only three faces meet, is
    the mean of the three texels that touch it.
    """
    size = faces.shape[1]
    padded = faces.new_empty(6, size + 2, size + 2, faces.shape[-1])
    padded[:, 1:-1, 1:-1] = faces
    beyond = face_directions(size, margin=1).to(faces.device)
    for rows, columns in _edges():
        face, right, down = face_position(beyond[:, rows, columns])
        # The direction of a border texel lies on the neighbour's outermost row; along that row a texel keeps its index.
        column = _nearest_texel(right, size)
        row = _nearest_texel(down, size)
        padded[:, rows, columns] = faces[face, row, column]
    for row, inner_row in ((0, 1), (-1, -2)):
        for column, inner_column in ((0, 1), (-1, -2)):
            touching = padded[:, inner_row, inner_column] + padded[:, row, inner_column] + padded[:, inner_row, column]
            padded[:, row, column] = touching / 3
    return padded


def _edges() -> tuple[tuple[int | slice, int | slice], ...]:
    inner = slice(1, -1)
    return ((0, inner), (-1, inner), (inner, 0), (inner, -1))


def _nearest_texel(position: Float[Tensor, "*p"], size: int) -> Int[Tensor, "*p"]:
    return ((position + 1) / 2 * size).floor().long().clamp(0, size - 1)


def from_environment(environment: Environment, size: int) -> Cubemap:
    """The environment resampled onto six faces of `size`² texels; a texel is the mean of its part of the map.

    Args:
        environment: the map.
        size: texels along a face's side; a quarter of the map's width keeps its resolution.
    """
    finer = max(1, -(-environment.radiance.shape[1] // (4 * size)))
    x, y, z = face_directions(size * finer).float().unbind(-1)
    fine = latlong.lookup(latlong.of(environment), x, y, z).permute(0, 3, 1, 2)
    return Cubemap(torch.nn.functional.avg_pool2d(fine, finer).permute(0, 2, 3, 1).contiguous())
