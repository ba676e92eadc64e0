"""Light from a photograph of a mirror ball: the surroundings that the ball shows, each by its direction."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import grid_sample

from fit_material.renderer.environment.environment import directions
from fit_material.renderer.errors.input_error import InputError
from fit_material.shaders.optics.fresnel import conductor

RIM = 0.15  # n·v within which the ball is too foreshortened: directions less than 17° off straight behind it
SMALLEST = 0.1  # of the picture's shorter side: radii that are looked for
TRIED_SIZE = 256  # pixels along the longer side, for finding the ball roughly
NEAR = 0.08  # of the radius: edges that belong to the outline
ON_OUTLINE = 1.0  # pixels off the circle
FEWEST_EDGES = 0.4  # of the outline, to be called one


@dataclass(frozen=True)
class Circle:
    """A ball's outline in pixels, (0, 0) the upper left corner of the upper left pixel."""

    x: float
    y: float
    radius: float


def find_ball(radiance: Float[np.ndarray, "h w 3"], file: Path) -> Circle:
    """The outline of the largest ball: Hough's circle, refined by the edges that lie on it.

    Args:
        radiance: of a photograph, finite.
        file: where it is from, for the error's sentence.

    Raises:
        InputError: no circle is seen.
    """
    from skimage.feature import canny

    grey = _tone_mapped(radiance)
    circle = _rough_circle(grey)
    points = np.argwhere(canny(grey, sigma=1.0))[:, ::-1] + 0.5
    if circle is not None:
        for reach in (NEAR * circle.radius, 4 * ON_OUTLINE, 2 * ON_OUTLINE, ON_OUTLINE):
            near = points[np.abs(_distance(points, circle) - circle.radius) < max(reach, ON_OUTLINE)]
            if len(near) < 2 * np.pi * circle.radius * FEWEST_EDGES:
                break
            circle = _through(near)
        else:
            return circle
    raise InputError(file, expected="a picture with the outline of a ball; or say where it is by --circle X Y RADIUS")


def _distance(points: Float[np.ndarray, "p 2"], circle: Circle) -> Float[np.ndarray, " p"]:
    """Of points from the circle's centre."""
    return np.hypot(points[:, 0] - circle.x, points[:, 1] - circle.y)


def _through(points: Float[np.ndarray, "p 2"]) -> Circle:
    """The circle through points, x² + y² = 2ax + 2by + c by least squares [Kåsa 1976]."""
    middle = points.mean(0)  # whose squares cancel fewer digits
    x, y = (points - middle).T
    a, b, c = np.linalg.lstsq(np.stack([2 * x, 2 * y, np.ones_like(x)], 1), x**2 + y**2)[0]
    return Circle(float(middle[0] + a), float(middle[1] + b), float(np.sqrt(c + a**2 + b**2)))


def unwrapped(
    radiance: Float[np.ndarray, "h w 3"],
    circle: Circle,
    n: Float[Tensor, "3"],
    k: Float[Tensor, "3"],
    height: int,
) -> Float[Tensor, "height width 3"]:
    """The surroundings as a latitude-longitude map, twice as wide as high.

    The camera is far away in direction +Z, so that every ray comes along -Z. Light from direction d is seen where the
    normal is halfway, h = (d + z)/|d + z|, and dimmed there by F(h·z; n, k). Straight behind the ball, where the
    outline shows less and less of more and more, the rim's light is continued [Debevec 1998, §5].

    Args:
        radiance: of the photograph.
        circle: the ball's outline in it.
        n, k: complex refractive index of the ball's surface.
        height: rows of the map.
    """
    towards = directions(height, 2 * height)
    half = torch.nn.functional.normalize(towards + torch.tensor([0.0, 0.0, 1 + 1e-9]), dim=-1)
    across = half[..., :2] * _inside(half[..., :2].norm(dim=-1))
    cosine = (1 - across.square().sum(-1)).sqrt()
    size = torch.tensor([radiance.shape[1], radiance.shape[0]], dtype=torch.float64)
    centre = torch.tensor([circle.x, circle.y], dtype=torch.float64)
    pixel = centre + circle.radius * across * torch.tensor([1.0, -1.0])
    picture = torch.from_numpy(radiance).double().movedim(-1, 0)[None]
    grid = (2 * pixel / size - 1)[None]
    seen = grid_sample(picture, grid, padding_mode="border", align_corners=False)[0].movedim(0, -1)
    return (seen / conductor(cosine[..., None], n.double(), k.double())).float()


def _inside(distance: Float[Tensor, "h w"]) -> Float[Tensor, "h w 1"]:
    """The factor that takes what lies beyond `RIM` back to it."""
    return ((1 - RIM**2) ** 0.5 / distance.clamp_min(1e-12)).clamp_max(1)[..., None]


def _rough_circle(grey: Float[np.ndarray, "h w"]) -> Circle | None:
    """The circle with the most edges on it, in a picture of at most `TRIED_SIZE`; None without any."""
    from skimage.feature import canny
    from skimage.transform import hough_circle, hough_circle_peaks

    step = -(-max(grey.shape) // TRIED_SIZE)
    small = grey[::step, ::step]
    shorter = min(small.shape)
    radii = np.arange(max(3, int(SMALLEST * shorter)), shorter // 2 + 1)
    edges = canny(small, sigma=1.0)
    if not len(radii) or not edges.any():
        return None
    _, x, y, radius = hough_circle_peaks(hough_circle(edges, radii), radii, total_num_peaks=1)
    return Circle(*(float(step * value) for value in (x[0] + 0.5, y[0] + 0.5, radius[0]))) if len(x) else None


def _tone_mapped(radiance: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
    """Luminance over itself and its median, in [0, 1): outlines count alike in light and shadow."""
    grey = np.maximum(radiance, 0).mean(-1).astype(float)
    return grey / (grey + max(float(np.median(grey[grey > 0])) if (grey > 0).any() else 1.0, 1e-12))
