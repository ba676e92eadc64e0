"""The orientations in which an environment may have been meant: rotated by right angles, mirrored, another axis up."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

# What takes a world direction to axes of which +Y is up, by the world's axis that is up: signed rows of (x, y, z).
_UPRIGHT = {
    "+Y": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "+Z": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-Z": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "-Y": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "+X": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "-X": ((0, 1, 0), (-1, 0, 0), (0, 0, 1)),
}


@dataclass(frozen=True)
class Orientation:
    """How the world lies in a map.

    Attributes:
        up: the world's axis that is the map's upper pole.
        turn: degrees more about it than the scene declares.
        mirrored: whether the map's columns run the other way.
    """

    up: str = "+Y"
    turn: int = 0
    mirrored: bool = False

    @property
    def changes(self) -> int:
        """How many of up, turn and mirroring are not as the scene declares."""
        return (self.up != "+Y") + (self.turn != 0) + self.mirrored

    def to_map(self, rotation: float) -> Float[Tensor, "3 3"]:
        """Orthogonal matrix from world directions to the map's own axes, of a map rotated by `rotation` degrees."""
        flip = torch.diag(torch.tensor([-1.0 if self.mirrored else 1.0, 1, 1], dtype=torch.float64))
        return flip @ about_y(rotation + self.turn).T @ upright(self.up)


GIVEN = Orientation()
UPS = tuple(_UPRIGHT)
TURNS = (0, 90, 180, 270)


def about_y(degrees: float) -> Float[Tensor, "3 3"]:
    """The rotation about +Y, counter-clockwise seen from above, float64."""
    sin, cos = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    return torch.tensor([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], dtype=torch.float64)


def upright(up: str) -> Float[Tensor, "3 3"]:
    """The rotation that brings an axis of the world to +Y, float64."""
    return torch.tensor(_UPRIGHT[up], dtype=torch.float64)


def orientations() -> list[Orientation]:
    """All 48, those first that slips lead to: the given one, rotated, mirrored, z-up, and combinations."""
    every = [Orientation(up, turn, m) for up, m, turn in itertools.product(UPS, (False, True), TURNS)]
    return sorted(every, key=lambda each: each.changes)  # stable: of equal ones in the order above
