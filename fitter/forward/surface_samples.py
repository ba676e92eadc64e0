"""Some thousand places on a surface that stand for all of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy import sparse
from scipy.spatial import KDTree

from fit_material.renderer.rays.gbuffer import GBuffer

NEAREST = 6
TURN = 0.15  # of the object's extent that a normal's turn by one radian counts as
SAME = 1e-4  # of the extent, below which a place is as good as met

Sparse = Any  # a csr_matrix, of which scipy's own annotations do not know that it has products and columns


@dataclass(frozen=True)
class Places:
    """Places [n] on a surface, at least one; values at each hold around it, where normals are alike.

    Attributes:
        surface: the places.
        extent: of the object, in world units.
    """

    surface: GBuffer
    extent: float

    def mixing(self, surface: GBuffer) -> Sparse:
        """How points [p] mix the nearest places, by their inverse squared distance: [p, n], rows of sum 1."""
        count, places = len(surface.hit), len(self.surface.hit)
        nearest = min(NEAREST, places)
        distance, index = self._tree.query(self._features(surface), nearest, workers=1)
        weight = 1 / (distance.reshape(-1, nearest) ** 2 + (SAME * self.extent) ** 2)
        weight /= weight.sum(1, keepdims=True)
        first = np.arange(count + 1) * nearest
        return sparse.csr_matrix((weight.ravel(), index.ravel().astype(np.int32), first), shape=(count, places))

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self._features(self.surface))

    def _features(self, surface: GBuffer) -> Float[np.ndarray, "p 6"]:
        return torch.cat([surface.position, TURN * self.extent * surface.normal], -1).numpy()
