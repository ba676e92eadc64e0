"""Occlusion inside a Dr.Jit kernel: the twin of `rays.occlusion`, which takes torch's tensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import torch
from drjit.llvm import Array4f, Float
from jaxtyping import Float as Floats
from torch import Tensor

from fit_material.renderer.rays.occlusion import Occluder


@dataclass(frozen=True)
class Blocked:
    """The places where rays towards the light start, and what they may meet.

    Attributes:
        starts: x, y, z of each ray, and a number that is not read: four are fetched at once.
        free: whether light passes, by origin and direction.
    """

    starts: Float
    free: Callable[[Any, Any], Any]

    @staticmethod
    def of(occluder: Occluder, starts: Floats[Tensor, "p r 3"]) -> Blocked:
        assert occluder.compiled is not None
        padded = torch.nn.functional.pad(starts.float(), (0, 1))
        return Blocked(Float(padded.flatten().numpy()), occluder.compiled)

    def before(self, ray: Any) -> Callable[[Any], Any]:
        """From directions to whether light from there reaches the start of these rays."""
        start = dr.gather(Array4f, self.starts, ray)
        return lambda direction: self.free((start[0], start[1], start[2]), direction)
