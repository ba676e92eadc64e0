"""One thing that is wrong with the input, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "silhouette",
    "up-axis",
    "environment-rotation",
    "environment-mirrored",
    "encoding",
    "exposure",
    "clipping",
    "values",
    "sharpness",
    "duplicate",
]


@dataclass(frozen=True)
class Finding:
    """A finding of the preflight.

    Attributes:
        kind: of fault.
        where: the field or fields of the scene file, and the photograph's name.
        value: what was found there, with its number.
        remedy: what to change.
    """

    kind: Kind
    where: str
    value: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.where}: {self.value}; {self.remedy}"


def percent(share: float) -> str:
    """A share for people, with a digit behind the point where it is small."""
    return f"{100 * share:.1f} %" if share < 0.0995 else f"{100 * share:.0f} %"
