"""A camera's pose by the object's outline: how far the mask's border is from the mesh's, along its normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fit_material.fitter.least_squares.noise import scatter
from fit_material.renderer.cameras.pose_offset import Motion, Pose
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import read_image
from fit_material.renderer.rays.gbuffer import Tracer
from fit_material.renderer.scene.fittable_values import FITTED
from fit_material.renderer.scene.scene_file import PhotographSpec

MOST_POINTS = 1000  # of a border; those of larger photographs are taken evenly
SMOOTH = 2.0  # pixels over which a border's normal is taken
REACHES = (2.0, 0.5, 0.15)  # how far an outline is looked for in turn, in standard deviations of a pose's rotation
NEAREST = 1.5  # pixels that are looked over at least
STEPS = 8  # of Gauss and Newton with each reach, at most
STILL = 0.3  # standard errors that end them
TRIED, HALVED = 24, 14  # places along a normal, and bisections between two of them: to a ten thousandth of the reach
MOVED = 0.5  # pixels by which derivatives move the outline
ROBUST_AT = 3.0  # standard deviations, beyond which a point counts by its size alone
LEAST_SCATTER = 0.01  # pixels, that coverages of 8 bits leave
MOST_APART = 1.5  # pixels, in the middle, between a mask's border and the outline that it shall be


@dataclass(frozen=True)
class Rows:
    """Whitened differences, and their derivative by the six numbers of one pose.

    Attributes:
        difference: of variance 1, robust.
        slope: its derivative.
    """

    difference: Float[Tensor, " r"]
    slope: Float[Tensor, "r 6"]

    @property
    def information(self) -> Float[Tensor, "6 6"]:
        return self.slope.T @ self.slope

    @property
    def gradient(self) -> Motion:
        return self.slope.T @ self.difference


@dataclass(frozen=True)
class Border:
    """The border of a photograph's mask or alpha channel.

    Attributes:
        place: film positions along it, x and y in pixels, as `Camera.rays` counts.
        outward: unit normals of the border there, on the film.
    """

    place: Float[Tensor, "p 2"]
    outward: Float[Tensor, "p 2"]

    @staticmethod
    def of(coverage: Float[np.ndarray, "h w"]) -> Border:
        """Where coverage is a half between the pixels' middles, but not along the frame."""
        from scipy.ndimage import gaussian_filter, map_coordinates
        from skimage.measure import find_contours

        found = np.concatenate([*find_contours(coverage, 0.5), np.zeros((0, 2))])
        size = np.array(coverage.shape)
        found = found[((found > 1) & (found < size - 2)).all(1)]
        found = found[:: -(-len(found) // MOST_POINTS) or 1]
        smooth = gaussian_filter(coverage, SMOOTH)
        slope = [map_coordinates(np.gradient(smooth, axis=axis), found.T, order=1, mode="nearest") for axis in (1, 0)]
        outward = -torch.from_numpy(np.stack(slope, -1)).double()
        place = torch.from_numpy(found[:, ::-1].copy()).double() + 0.5
        certain = outward.norm(dim=-1) > 0
        return Border(place[certain], torch.nn.functional.normalize(outward[certain], dim=-1))

    def distance(self, pose: Pose, trace: Tracer, reach: float) -> Float[Tensor, " p"]:
        """How far outside the border the object ends, in pixels along the normal; NaN where it does not within reach.

        Of several such places the nearest.
        """
        along = torch.linspace(-reach, reach, TRIED + 1, dtype=torch.float64)
        covered = self._covered([pose], trace, along.expand(1, len(self.place), -1))[0]
        ends = covered[:, :-1] & ~covered[:, 1:]
        middle = (along[:-1] + along[1:]) / 2
        chosen = torch.where(ends, middle.abs(), torch.inf).argmin(1)
        found = self._between([pose], trace, along[chosen][None], along[chosen + 1][None])[0]
        return torch.where(ends.any(1), found, torch.nan)

    def _between(
        self, poses: Sequence[Pose], trace: Tracer, inside: Float[Tensor, "c p"], outside: Float[Tensor, "c p"]
    ) -> Float[Tensor, "c p"]:
        """Where the object ends between places that it covers and others that it does not, by bisection."""
        for _ in range(HALVED):
            middle = (inside + outside) / 2
            covered = self._covered(poses, trace, middle[..., None])[..., 0]
            inside, outside = torch.where(covered, middle, inside), torch.where(covered, outside, middle)
        return (inside + outside) / 2

    def _covered(self, poses: Sequence[Pose], trace: Tracer, along: Float[Tensor, "c p q"]) -> Bool[Tensor, "c p q"]:
        """Whether the object, by each of the poses, covers places so many pixels outside the border."""
        place = self.place[:, None] + along[..., None] * self.outward[:, None]
        rays = [pose.camera.rays(*each.flatten(0, 1).unbind(-1)) for pose, each in zip(poses, place, strict=True)]
        origins, directions = (torch.cat(each) for each in zip(*rays, strict=True))
        return trace(origins, directions).hit.reshape(along.shape)

    def rows(self, pose: Pose, trace: Tracer, reach: float) -> Rows:
        """The distances of the outline that lies within reach, over the scatter that they show."""
        distance = self.distance(pose, trace, reach)
        near = distance.isfinite()
        here, distance = Border(self.place[near], self.outward[near]), distance[near]
        steps = MOVED * pose.per_pixel
        moved = [pose.by(side * step) for side in (1, -1) for step in torch.diag(steps)]
        ends = torch.stack([distance - 2 * MOVED, distance + 2 * MOVED], -1).expand(12, -1, -1)
        inside, outside = here._covered(moved, trace, ends).unbind(-1)
        ahead, behind = here._between(moved, trace, *ends.unbind(-1)).split(6)
        known = (inside & ~outside).all(0)
        distance, slope = distance[known], ((ahead - behind) / (2 * steps[:, None]))[:, known].T
        sigma = max(scatter(distance), LEAST_SCATTER) if len(distance) else 1.0
        weight = (ROBUST_AT / (distance / sigma).abs().clamp_min(ROBUST_AT)).sqrt() / sigma
        return Rows(weight * distance, weight[:, None] * slope)

    def registered(self, pose: Pose, trace: Tracer) -> Pose:
        """The pose whose outline comes nearest; motions that outlines do not determine are left as they were."""
        for reach in REACHES:
            for _ in range(STEPS):
                rows = self.rows(pose, trace, self.reach(pose, reach))
                step = -torch.linalg.solve(rows.information + torch.eye(6).double(), rows.gradient + pose.motion)
                pose = pose.by(step)
                if float((rows.slope @ step).norm()) < STILL:
                    break
        return pose

    def reach(self, pose: Pose, deviations: float = REACHES[-1]) -> float:
        """The pixels that an outline moves by, if the pose turns by so many standard deviations."""
        return max(NEAREST, deviations / float(pose.per_pixel[0]))

    def apart(self, pose: Pose, trace: Tracer) -> float:
        """The median distance between both, in pixels, as far as the widest reach; infinite where there is none."""
        distance = self.distance(pose, trace, self.reach(pose, REACHES[0])).abs()
        return float(distance.nan_to_num(torch.inf).median()) if len(distance) else torch.inf


def border_of(spec: PhotographSpec, place: tuple[Path, str]) -> Border:
    """The border that a photograph's alpha channel or mask shows.

    Args:
        spec: the photograph's table.
        place: file and field, for the error's sentence.

    Raises:
        InputError: it has neither, or they show no border.
    """
    alpha = read_image(spec.image, None if spec.encoding == FITTED else spec.encoding).alpha
    if (alpha is None or alpha.min() == alpha.max()) and spec.mask is not None:
        alpha = read_image(spec.mask, "linear").radiance.mean(-1)
    if alpha is not None:
        found = Border.of(np.nan_to_num(alpha).clip(0, 1))
        if len(found.place) >= 6:
            return found
    expected = "an alpha channel or a mask, whose border is the object's outline, for --refine-pose"
    raise InputError(place[0], f"{place[1]}.mask", "missing" if alpha is None else "without a border", expected)
