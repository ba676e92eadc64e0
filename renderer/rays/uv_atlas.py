"""The surface laid out flat by its texture coordinates: which place each texel is of, and what to put elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree

from fit_material.renderer.geometry.mesh import Mesh
from fit_material.renderer.mitsuba.raycast import barycentric, caster

NEAREST = 8  # texels around a hole's, over the surface, that it is filled from
ASIDE = (6.18e-4, 4.14e-4)  # of a texel: rays through their very centres often run along edges, and may miss both faces


@dataclass(frozen=True)
class Unwrapped:
    """Where texels' centres lie on a surface.

    Attributes:
        inside: texels that are of the surface, [h, w].
        position: of those, in world space, in their order, [n, 3].
    """

    inside: Bool[np.ndarray, "h w"]
    position: Float[np.ndarray, "n 3"]


def unwrapped(mesh: Mesh, material: int, height: int, width: int) -> Unwrapped:
    """Lay out the faces of one material, moved by whole numbers to [0, 1]², and look at them from above.

    Args:
        mesh: with texture coordinates.
        material: index among the mesh's.
        height, width: of the texture.
    """
    assert mesh.uv is not None
    faces = mesh.faces[mesh.material == material]
    corner = mesh.uv[faces]
    corner = corner - np.floor(corner.mean(1, keepdims=True))
    flat = np.concatenate([corner, np.zeros_like(corner[..., :1])], -1)
    layout = Mesh(
        flat.reshape(-1, 3), np.arange(flat.shape[0] * 3).reshape(-1, 3), None, None, np.zeros(len(faces), int)
    )
    row, column = np.meshgrid(np.arange(height), np.arange(width), indexing="ij")
    right, below = 0.5 + np.array(ASIDE)
    centres = np.stack([(column + right) / width, 1 - (row + below) / height, np.ones(row.shape)], -1).reshape(-1, 3)
    down = np.broadcast_to([0.0, 0.0, -1.0], centres.shape)
    face = caster(layout)(torch.from_numpy(centres), torch.from_numpy(down.copy()))
    inside = face >= 0
    weights = barycentric(flat[face[inside]], centres[inside], down[inside])
    position = np.einsum("ni,nic->nc", weights, mesh.vertices[faces[face[inside]]])
    return Unwrapped(inside.reshape(height, width), position)


def overlap(mesh: Mesh, material: int, layout: Unwrapped) -> float:
    """How many places of one material's surface share a texel in the mean: 1 where none does."""
    assert mesh.uv is not None
    corner = mesh.uv[mesh.faces[mesh.material == material]]
    (ax, ay), (bx, by) = ((corner[:, i] - corner[:, 0]).T for i in (1, 2))
    return float(np.abs(ax * by - ay * bx).sum() / 2 / max(float(layout.inside.mean()), 1 / layout.inside.size))


def filled(
    texels: Float[np.ndarray, "h w c"], known: Bool[np.ndarray, "h w"], layout: Unwrapped
) -> Float[np.ndarray, "h w c"]:
    """The texture without holes or seams.

    What is of the surface and not known is a mean of the known texels nearest to it on the surface itself, wherever the
    texture has them, so that both sides of a seam get the same. What is of no surface repeats the texel beside it, so
    that a lookup near a seam, or in smaller copies of the texture, finds no foreign colour.

    Args:
        texels: values, of any number of channels.
        known: which of them are; known ones that are of no surface stay as well.
        layout: of the same size.
    """
    found, inside = texels.copy(), layout.inside
    source = known[inside]
    if source.any() and not source.all():
        values = texels[inside]
        count = min(NEAREST, int(source.sum()))
        distance, index = KDTree(layout.position[source]).query(layout.position[~source], count, workers=1)
        distance, index = distance.reshape(-1, count), index.reshape(-1, count)
        weight = 1 / np.maximum(distance, 1e-12) ** 2
        weight /= weight.sum(1, keepdims=True)
        values[~source] = np.einsum("nk,nkc->nc", weight, values[source][index])
        found[inside] = values
    there = inside | known if source.any() else known
    if not there.any():
        return found
    rows, columns = distance_transform_edt(~there, return_distances=False, return_indices=True)  # type: ignore
    return found[rows, columns]
