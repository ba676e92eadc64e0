"""Diffuse light on millions of pixels of an object that hides light from itself: by rays from some thousand places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import KDTree
from torch import Tensor

from renderer.environment import Environment
from renderer.gbuffer import GBuffer
from renderer.irradiance import diffuse_table
from renderer.occlusion import Occluder

PLACES = 40000  # of a surface that fills 200² texels about every one
BLOCKS = 768  # of the environment, that rays are cast towards: shadows need many places before many directions
NEAREST = 6
TURN = 0.15  # of the object's extent that a normal's turn by one radian counts as


@dataclass(frozen=True)
class OccludedBody:
    """Share of the diffuse light that reaches places of an object, per channel.

    Attributes:
        tree: of the places, by position and normal.
        share: of the irradiance that no part of the object would hide, [places, 3].
        extent: of the object.
    """

    tree: KDTree
    share: Float[np.ndarray, "n 3"]
    extent: float

    @staticmethod
    def of(surface: GBuffer, occluder: Occluder, environment: Environment) -> OccludedBody:
        """From places [p] on the surface, where rays are cast towards all of the environment."""
        hidden = diffuse_table(surface.normal, environment, 1, (occluder, occluder.origins(surface)), BLOCKS)[:, 0]
        unhidden = diffuse_table(surface.normal, environment, 1, most=BLOCKS)[:, 0].clamp_min(1e-20)
        extent = float((surface.position.amax(0) - surface.position.amin(0)).norm())
        share = (hidden / unhidden).clamp(0, 1).double().numpy()
        return OccludedBody(KDTree(_features(surface, extent)), share, extent)

    def at(self, surface: GBuffer) -> Float[Tensor, "p 3"]:
        """The share at points [p], from the nearest places that face alike, by their inverse squared distance."""
        count = min(NEAREST, len(self.share))
        distance, index = self.tree.query(_features(surface, self.extent), count, workers=1)
        distance, index = distance.reshape(-1, count), index.reshape(-1, count)
        weight = 1 / (distance**2 + (1e-4 * self.extent) ** 2)
        weight /= weight.sum(1, keepdims=True)
        return torch.from_numpy(np.einsum("pk,pkc->pc", weight, self.share[index]))


def _features(surface: GBuffer, extent: float) -> Float[np.ndarray, "p 6"]:
    return torch.cat([surface.position, TURN * extent * surface.normal], -1).numpy()
