"""`[photographs.camera.lens]`: intrinsics as calibration programs give them, checked."""

from __future__ import annotations

import math

from pydantic import PositiveFloat, model_validator

from fit_material.renderer.cameras.lens import Lens
from fit_material.renderer.files.validation import Checked, unexpected

NARROWEST, WIDEST = 0.01, 179.0  # horizontal angle of view in degrees, as `fov` may have it


class LensSpec(Checked):
    """Intrinsics of `cameras.lens`, for a picture of `width` × `height` pixels; one of another size is scaled to it.

    `fy` is `fx` where it is not given, the principal point the picture's centre, and distortion nought.
    """

    width: PositiveFloat
    height: PositiveFloat
    fx: PositiveFloat
    fy: PositiveFloat | None = None
    cx: float | None = None
    cy: float | None = None
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    @model_validator(mode="after")
    def _can_be_undone(self) -> LensSpec:
        if not NARROWEST <= self.fov <= WIDEST:
            expected = f"a focal length in pixels, of a horizontal angle from {NARROWEST:g} to {WIDEST:g} degrees"
            raise unexpected(expected, key="fx", value=self.fx)
        if not self.lens(self.width, self.height).can_be_undone(self.width, self.height):
            given = ", ".join(f"{key} = {getattr(self, key):g}" for key in ("k1", "k2", "p1", "p2", "k3"))
            raise unexpected("distortion that does not fold the picture over inside its frame", value=given)
        return self

    @property
    def fov(self) -> float:
        """Full horizontal angle in degrees of the pinhole without distortion and with the axis in the middle."""
        return math.degrees(2 * math.atan(self.width / (2 * self.fx)))

    @property
    def is_pinhole(self) -> bool:
        """Whether it is a centred pinhole with square pixels, which `fov` describes wholly."""
        lens = self.lens(self.width, self.height)
        centred = max(abs(lens.cx - self.width / 2), abs(lens.cy - self.height / 2)) == 0
        return centred and lens.fx == lens.fy and not any((lens.k1, lens.k2, lens.p1, lens.p2, lens.k3))

    def lens(self, width: float, height: float) -> Lens:
        """The lens of a picture of `width` × `height` pixels."""
        across, down = width / self.width, height / self.height
        return Lens(
            self.fx * across,
            (self.fx if self.fy is None else self.fy) * down,
            (self.width / 2 if self.cx is None else self.cx) * across,
            (self.height / 2 if self.cy is None else self.cy) * down,
            self.k1,
            self.k2,
            self.p1,
            self.p2,
            self.k3,
        )
