"""A lens that is not an ideal, centred pinhole: principal point, oblong pixels, and OpenCV's five distortions."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

STEPS = 50  # of Newton's method at most; some six are the rule
CONVERGED = 1e-13  # of a step, in focal lengths
ROUND_TRIP = 1e-9  # in focal lengths: a hundred thousandth of a pixel
BORDER, ALONG = 65, 33  # points on each side of a picture, and on the way to each, where the lens is tried

Plane = Float[Tensor, "*p"]


@dataclass(frozen=True)
class Lens:
    """Intrinsics of a camera; lengths in pixels, (0, 0) the upper left corner of the upper left pixel.

        x_d = x (1 + k₁r² + k₂r⁴ + k₃r⁶) + 2p₁xy + p₂(r² + 2x²)
        y_d = y (1 + k₁r² + k₂r⁴ + k₃r⁶) + p₁(r² + 2y²) + 2p₂xy      [Brown 1966; OpenCV, camera calibration]
        pixel = (fx x_d + cx, fy y_d + cy)

    x, y and r are right, down and away from the axis on the plane one focal length in front.

    Attributes:
        fx, fy: focal lengths in pixels' widths and heights, > 0.
        cx, cy: where the axis meets the film.
        k1, k2, k3: radial distortion.
        p1, p2: tangential distortion.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def plane(self, x: Plane, y: Plane) -> tuple[Plane, Plane]:
        """Where on the undistorted plane the light of a film position comes from, right and down, float64."""
        return self.undistorted((x.double() - self.cx) / self.fx, (y.double() - self.cy) / self.fy)

    def distorted(self, x: Plane, y: Plane) -> tuple[Plane, Plane]:
        """x_d and y_d of x and y."""
        r2 = x**2 + y**2
        radial = self._radial(r2)
        right = x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x**2)
        down = y * radial + self.p1 * (r2 + 2 * y**2) + 2 * self.p2 * x * y
        return right, down

    def undistorted(self, right: Plane, down: Plane) -> tuple[Plane, Plane]:
        """x and y of x_d and y_d, by Newton's method from there on."""
        x, y = right, down
        for _ in range(STEPS):
            (found_right, found_down), (a, b, d) = self.distorted(x, y), self._slopes(x, y)
            off_right, off_down = found_right - right, found_down - down
            determinant = a * d - b**2
            step_x, step_y = (d * off_right - b * off_down) / determinant, (a * off_down - b * off_right) / determinant
            x, y = x - step_x, y - step_y
            if max(float(step_x.abs().max()), float(step_y.abs().max())) <= CONVERGED:
                break
        return x, y

    def can_be_undone(self, width: float, height: float) -> bool:
        """Whether every film position of a picture of that size has one point of the plane, as polynomials allow."""
        x, y = _border(width, height)
        right, down = (x - self.cx) / self.fx, (y - self.cy) / self.fy
        plane = self.undistorted(right, down)
        again = self.distorted(*plane)
        back = torch.hypot(again[0] - right, again[1] - down) <= ROUND_TRIP
        share = torch.linspace(0, 1, ALONG, dtype=torch.float64)[:, None]
        return bool((back & self._keeps_order(share * plane[0], share * plane[1]).all(0)).all())

    def _keeps_order(self, x: Plane, y: Plane) -> Bool[Tensor, "*p"]:
        """Where the distorted picture is not folded over: the Jacobian has positive eigenvalues."""
        a, b, d = self._slopes(x, y)
        return (a + d > 0) & (a * d - b**2 > 0)

    def _radial(self, r2: Plane) -> Plane:
        return 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))

    def _slopes(self, x: Plane, y: Plane) -> tuple[Plane, Plane, Plane]:
        """∂x_d/∂x, ∂x_d/∂y = ∂y_d/∂x, ∂y_d/∂y."""
        r2 = x**2 + y**2
        radial, slope = self._radial(r2), self.k1 + r2 * (2 * self.k2 + 3 * r2 * self.k3)
        a = radial + 2 * x**2 * slope + 2 * self.p1 * y + 6 * self.p2 * x
        b = 2 * x * y * slope + 2 * self.p1 * x + 2 * self.p2 * y
        d = radial + 2 * y**2 * slope + 6 * self.p1 * y + 2 * self.p2 * x
        return a, b, d


def _border(width: float, height: float) -> tuple[Float[Tensor, " p"], Float[Tensor, " p"]]:
    """Film positions all round the picture: distortion is greatest there."""
    share = torch.linspace(0, 1, BORDER, dtype=torch.float64)
    zero, one = torch.zeros_like(share), torch.ones_like(share)
    x = torch.cat([share, share, zero, one])
    y = torch.cat([zero, one, share, share])
    return x * width, y * height
