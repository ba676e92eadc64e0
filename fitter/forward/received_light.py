"""Diffuse light at points of an object that sends light to itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fit_material.fitter.forward.surface_samples import Places
from fit_material.renderer.rays.gbuffer import GBuffer


@dataclass(frozen=True)
class Met:
    """Points [m] that rays meet on an object's front: what their albedo depends on.

    Attributes:
        material: index among the mesh's.
        uv: texture coordinates.
    """

    material: Int[Tensor, " m"]
    uv: Float[Tensor, "m 2"]


Albedo = Callable[[Met], Float[np.ndarray, "m 3"]]


@dataclass(frozen=True)
class DiffuseLight:
    """Diffuse light at places of an object.

    Attributes:
        places: where it is known.
        share: of the light that the far surroundings would send if nothing hid them, what arrives, in [0, 1], [n, 3].
        returned: light by way of the object itself, [n, 3].
        total: all light, that of lights beside the environment included, [n, 3].
        albedo: by which the object returns it.
    """

    places: Places
    share: Float[np.ndarray, "n 3"]
    returned: Float[np.ndarray, "n 3"]
    total: Float[np.ndarray, "n 3"]
    albedo: Albedo

    def at(self, surface: GBuffer) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 3"]]:
        """`share` and `returned` at points [p]."""
        mixing = self.places.mixing(surface)
        return torch.from_numpy(mixing @ self.share), torch.from_numpy(mixing @ self.returned)
